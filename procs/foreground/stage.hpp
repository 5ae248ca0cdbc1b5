#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-foreground: RGBD_FRAME in, FOREGROUND out.
namespace weft::foreground_process {

/// Settings: those of foreground::ForegroundOptions.
std::unique_ptr<stage::Stage> make_stage(const Settings& settings);

/// All settings with their defaults and documentation, as YAML.
std::string settings_reference();

}  // namespace weft::foreground_process
