#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// weft-describe: RGBD_FRAME and FOREGROUND to WORDS_SIFT (or the words of another descriptor).
namespace weft::describe_process {

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);
std::string settings_reference();

}  // namespace weft::describe_process
