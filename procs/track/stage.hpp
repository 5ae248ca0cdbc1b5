#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-track: RGBD_FRAME, PLANES and, over a feedback edge, MAP_UPDATE to CAMERA_POSE and
/// KEYFRAME.
namespace weft::track_process {

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::track_process
