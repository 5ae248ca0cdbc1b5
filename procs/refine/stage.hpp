#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-refine: WORDS_* and PART_CANDIDATES to PART_DETECTIONS.
namespace weft::refine_process {

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::refine_process
