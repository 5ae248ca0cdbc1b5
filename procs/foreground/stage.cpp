#include "procs/foreground/stage.hpp"

#include <opencv2/core.hpp>

#include "foreground/foreground.hpp"
#include "messages/foreground.hpp"
#include "messages/rgbd.hpp"

namespace weft::foreground_process {

namespace {

using foreground::Foreground;

class ForegroundStage : public stage::Stage {
 public:
  explicit ForegroundStage(const foreground::ForegroundOptions& options) : options_(options) {
    interface_.name = "foreground";
    interface_.inputs = {stage::port<rgbd_frame_t>("RGBD_FRAME")};
    interface_.outputs = {stage::port<foreground_t>("FOREGROUND")};
    interface_.settings_hash = options_hash(options);
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const bool live = options_.mode == Foreground::Source::kLive;
    const rgbd::RgbdFrame frame = messages::from_message(
        inputs.get<rgbd_frame_t>("RGBD_FRAME"), {.colour = live, .depth = true, .mask = !live});
    if (frame.depth.empty()) throw stage::InvalidInput("RGBD_FRAME: the frame has no depth");
    if (live && frame.colour.empty())
      throw stage::InvalidInput("RGBD_FRAME: the frame has no colour");
    const Foreground found = foreground::find_foreground(frame, options_);
    messages::to_message(found, outputs.at<foreground_t>("FOREGROUND"));
    if (live && !found.table)
      outputs.nothing(stage::Reason::kNoTable, "no table plane was found");
    else if (cv::countNonZero(found.mask) == 0)
      outputs.nothing(stage::Reason::kNoGarment, "nothing lies on the table");
  }

 private:
  foreground::ForegroundOptions options_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  foreground::ForegroundOptions options;
  settings.read(options);
  return std::make_unique<ForegroundStage>(options);
}

std::string settings_reference() { return options_to_yaml(foreground::ForegroundOptions{}); }

}  // namespace weft::foreground_process
