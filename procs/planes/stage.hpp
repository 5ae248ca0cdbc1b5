#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-planes: RGBD_FRAME to PLANES.
namespace weft::planes_process {

/// Settings: those of plane::ExtractorOptions, and whether the label image is sent.
std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::planes_process
