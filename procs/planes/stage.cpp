#include "procs/planes/stage.hpp"

#include "messages/planes.hpp"
#include "messages/rgbd.hpp"
#include "plane/extractor.hpp"

namespace weft::planes_process {
namespace {

struct PlanesOptions {
  bool labels = true;
  plane::ExtractorOptions extractor;

  void visit(OptionVisitor& v) {
    v.field("labels", labels, "send the label image, too: for pictures and evaluation");
    v.group("extractor", extractor);
  }
  void validate() const {
    validate_fields(*this, "PlanesOptions");
    extractor.validate();
  }
};

class PlanesStage : public stage::Stage {
 public:
  explicit PlanesStage(const PlanesOptions& options)
      : options_(options), extractor_(options.extractor) {
    interface_.name = "planes";
    interface_.inputs = {stage::port<rgbd_frame_t>("RGBD_FRAME")};
    interface_.outputs = {stage::port<planes_t>("PLANES")};
    interface_.settings_hash = options_hash(options);
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const rgbd::RgbdFrame frame = messages::from_message(
        inputs.get<rgbd_frame_t>("RGBD_FRAME"), {.colour = false, .depth = true, .mask = false});
    const auto extraction = extractor_.extract(frame);
    messages::to_message(extraction, frame.camera, options_.labels, outputs.at<planes_t>("PLANES"));
    if (extraction.planes.empty() && extraction.cylinders.empty())
      outputs.nothing(stage::Reason::kNoPlane, "no plane and no cylinder is seen");
  }

 private:
  PlanesOptions options_;
  plane::Extractor extractor_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  PlanesOptions options;
  settings.read(options);
  return std::make_unique<PlanesStage>(options);
}

std::string settings_reference() { return options_to_yaml(PlanesOptions{}); }

}  // namespace weft::planes_process
