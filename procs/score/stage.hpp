#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-score: WORDS_* and IMAGE_PRIOR to PART_CANDIDATES and PROBABILITY_MAP.
namespace weft::score_process {

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::score_process
