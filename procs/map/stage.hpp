#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-map: KEYFRAME to MAP_UPDATE; with `garments` also what the part detector finds to
/// MAP_OBJECTS.
namespace weft::map_process {

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::map_process
