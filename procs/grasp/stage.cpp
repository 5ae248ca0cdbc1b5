#include "procs/grasp/stage.hpp"

#include "detector/grasp.hpp"
#include "messages/detections.hpp"
#include "messages/foreground.hpp"
#include "messages/grasp.hpp"
#include "messages/rgbd.hpp"

namespace weft::grasp_process {

namespace {

class GraspStage : public stage::Stage {
 public:
  explicit GraspStage(const detector::GraspOptions& options)
      : options_(options), T_base_camera_(detector::base_from_camera(options)) {
    interface_.name = "grasp";
    interface_.inputs = {stage::port<rgbd_frame_t>("RGBD_FRAME"),
                         stage::port<foreground_t>("FOREGROUND"),
                         stage::port<part_detections_t>("PART_DETECTIONS")};
    interface_.outputs = {stage::port<grasps_t>("GRASPS")};
    interface_.settings_hash = options_hash(options);
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const auto& detections_message = inputs.get<part_detections_t>("PART_DETECTIONS");
    if (detections_message.status.code == status_t::NOTHING) {
      outputs.nothing(static_cast<stage::Reason>(detections_message.status.reason),
                      detections_message.status.text);
      return;
    }
    const auto detections = messages::from_message(detections_message).detections;
    const auto foreground = messages::from_message(inputs.get<foreground_t>("FOREGROUND"));
    const rgbd::RgbdFrame frame = messages::from_message(
        inputs.get<rgbd_frame_t>("RGBD_FRAME"), {.colour = false, .depth = true, .mask = false});
    if (frame.depth.empty()) throw stage::InvalidInput("RGBD_FRAME: the frame has no depth");
    if (foreground.mask.size() != frame.depth.size())
      throw stage::InvalidInput("FOREGROUND: the mask is not of the frame's size");
    const auto grasps =
        detector::find_grasps(frame, foreground.mask, foreground.table, detections, options_);
    messages::to_message(grasps, T_base_camera_, outputs.at<grasps_t>("GRASPS"));
    if (grasps.empty())
      outputs.nothing(stage::Reason::kNothingFound, "no detection has a place to grasp");
  }

 private:
  detector::GraspOptions options_;
  std::optional<Eigen::Isometry3d> T_base_camera_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  detector::GraspOptions options;
  settings.read(options);
  return std::make_unique<GraspStage>(options);
}

std::string settings_reference() { return options_to_yaml(detector::GraspOptions{}); }

}  // namespace weft::grasp_process
