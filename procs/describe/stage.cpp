#include "procs/describe/stage.hpp"

#include <cctype>
#include <opencv2/core.hpp>

#include "base/options.hpp"
#include "bovw/describe.hpp"
#include "messages/foreground.hpp"
#include "messages/rgbd.hpp"
#include "messages/words.hpp"

namespace weft::describe_process {
namespace {

struct StageOptions {
  std::string vocabulary = "../models/parts-sift/vocabulary-sift.blob";
  int threads = 0;
  bovw::DescribeOptions describe;

  void visit(OptionVisitor& v) {
    v.field(
        "vocabulary", vocabulary,
        "vocabulary file, relative to this file; its own settings are the defaults of all below "
        "but threads, and others are refused: train again to change them");
    v.field("threads", threads, {0, 256}, "", "0: one for each core; the answer is the same");
    describe.visit(v);
  }
  void validate() const {
    validate_fields(*this, "DescribeOptions");
    describe.validate();
  }
};

std::string channel_of(const std::string& descriptor) {
  std::string channel = "WORDS_";
  for (const unsigned char c : descriptor) channel += static_cast<char>(std::toupper(c));
  return channel;
}

class DescribeStage : public stage::Stage {
 public:
  DescribeStage(const StageOptions& options, bovw::Vocabulary vocabulary)
      : options_(options),
        vocabulary_(std::move(vocabulary)),
        descriptor_(descriptor::make_descriptor(options.describe.descriptor)),
        channel_(channel_of(descriptor_->name())) {
    interface_.name = "describe-" + descriptor_->name();
    interface_.inputs = {stage::port<rgbd_frame_t>("RGBD_FRAME"),
                         stage::port<foreground_t>("FOREGROUND")};
    interface_.outputs = {stage::port<words_t>(channel_)};
    // Neither the place of the model file nor the number of threads decides the answer.
    interface_.settings_hash = options_hash(options_.describe);
    interface_.model_hash = vocabulary_.hash();
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const auto& frame_message = inputs.get<rgbd_frame_t>("RGBD_FRAME");
    const auto& foreground_message = inputs.get<foreground_t>("FOREGROUND");
    for (const auto* status : {&frame_message.status, &foreground_message.status}) {
      if (status->code == status_t::NOTHING)
        return outputs.nothing(static_cast<stage::Reason>(status->reason), status->text);
    }
    const auto foreground = messages::from_message(foreground_message);
    const auto frame = messages::from_message(
        frame_message, {descriptor_->uses_colour(), descriptor_->uses_depth(), false});
    if (foreground.mask.size() != cv::Size(frame.camera.width, frame.camera.height))
      throw stage::InvalidInput("FOREGROUND: the mask is not of the frame's size");
    if (cv::countNonZero(foreground.mask) == 0)
      return outputs.nothing(stage::Reason::kNoGarment, "the garment mask is empty");
    if (options_.describe.view.rectified && !foreground.table)
      return outputs.nothing(stage::Reason::kNoTable, "the rectified view needs a table plane");
    const auto described = bovw::describe_frame(frame, foreground.mask,
                                                foreground.table ? &*foreground.table : nullptr,
                                                options_.describe, *descriptor_, options_.threads);
    messages::to_message(
        bovw::quantise(described, descriptor_->name(), vocabulary_, options_.threads),
        outputs.at<words_t>(channel_));
    if (described.field.points.empty())
      outputs.nothing(stage::Reason::kNoWords, "no grid point inside the mask can be described");
  }

 private:
  StageOptions options_;
  bovw::Vocabulary vocabulary_;
  std::unique_ptr<descriptor::DenseDescriptor> descriptor_;
  std::string channel_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  StageOptions options;
  settings.read(options);
  auto vocabulary = bovw::Vocabulary::read(settings.path(options.vocabulary));
  Settings::from_text(vocabulary.settings_yaml(), settings.path(options.vocabulary))
      .read(options.describe);
  settings.read(options);  // what is written there goes before
  bovw::check_settings(vocabulary, options.describe);
  return std::make_unique<DescribeStage>(options, std::move(vocabulary));
}

std::string settings_reference() { return options_to_yaml(StageOptions{}); }

}  // namespace weft::describe_process
