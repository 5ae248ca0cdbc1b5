#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-prior: WORDS_* to IMAGE_PRIOR.
namespace weft::prior_process {

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::prior_process
