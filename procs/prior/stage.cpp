#include "procs/prior/stage.hpp"

#include "base/options.hpp"
#include "detector/prior.hpp"
#include "messages/prior.hpp"
#include "messages/words.hpp"

namespace weft::prior_process {
namespace {

struct PriorOptions {
  std::string model = "../models/parts-sift/prior.blob";
  std::vector<std::string> words = {"WORDS_SIFT"};
  detector::PriorMode mode = detector::PriorMode::kOff;

  void visit(OptionVisitor& v) {
    v.field("model", model, "model file, relative to this file");
    v.field("words", words, "channels of the words, in the order of the model's descriptors");
    v.choice("mode", mode,
             {{"off", detector::PriorMode::kOff},
              {"soft", detector::PriorMode::kSoft},
              {"hard", detector::PriorMode::kHard}},
             "off: every part is searched; soft: and detections are weighed by the prior; hard: "
             "parts below their threshold are not searched");
  }
  void validate() const { validate_fields(*this, "PriorOptions"); }
};

class PriorStage : public stage::Stage {
 public:
  explicit PriorStage(const Settings& settings) {
    settings.read(options_);
    model_ = detector::PriorModel::read(settings.path(options_.model));
    if (model_.blocks.size() != options_.words.size()) {
      throw Error(settings.name() + ": words: the model wants " +
                  std::to_string(model_.blocks.size()) + " channels");
    }
    interface_.name = "prior";
    for (std::size_t i = 0; i < options_.words.size(); ++i)
      interface_.inputs.push_back(
          stage::port<words_t>(options_.words[i], model_.blocks[i].vocabulary_hash));
    interface_.outputs = {stage::port<image_prior_t>("IMAGE_PRIOR")};
    // The place of the model file is no setting of the answer; its content is in model_hash.
    auto hashed = options_;
    hashed.model.clear();
    interface_.settings_hash = options_hash(hashed);
    interface_.model_hash = model_.hash;
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    std::vector<bovw::WordGrid> grids;
    bool any = false;
    for (const auto& channel : options_.words) {
      const auto& message = inputs.get<words_t>(channel);
      if (message.status.code == status_t::NOTHING) {
        return outputs.nothing(static_cast<stage::Reason>(message.status.reason),
                               message.status.text);
      }
      grids.push_back(messages::from_message(message));
      for (const auto cell : grids.back().cells) any = any || cell >= 0;
    }
    if (!any) return outputs.nothing(stage::Reason::kNoWords, "no grid point carries a word");
    std::vector<const bovw::WordGrid*> pointers;
    for (const auto& grid : grids) pointers.push_back(&grid);
    messages::to_message(detector::evaluate_prior(model_, pointers, options_.mode), options_.mode,
                         model_.hash, outputs.at<image_prior_t>("IMAGE_PRIOR"));
  }

 private:
  PriorOptions options_;
  detector::PriorModel model_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  return std::make_unique<PriorStage>(settings);
}

std::string settings_reference() { return options_to_yaml(PriorOptions{}); }

}  // namespace weft::prior_process
