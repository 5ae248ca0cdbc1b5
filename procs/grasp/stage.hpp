#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-grasp: RGBD_FRAME, FOREGROUND and PART_DETECTIONS in, GRASPS out.
namespace weft::grasp_process {

/// Settings: those of detector::GraspOptions.
std::unique_ptr<stage::Stage> make_stage(const Settings& settings);

/// All settings with their defaults and documentation, as YAML.
std::string settings_reference();

}  // namespace weft::grasp_process
