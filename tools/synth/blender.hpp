#pragma once

#include <functional>
#include <string>
#include <vector>

namespace weft::synth {

/// Path of the program blender. Throws Error with the remedy where it is not installed.
std::string find_blender();

/// Runs `blender SCRIPT -- ARGUMENTS` headless, in one thread (with more, results change from run
/// to run) and waits for it. It is killed, and false returned, once stopped() says so; it dies with
/// this program. Throws Error with the last lines of its output when it fails.
bool run_blender(const std::string& script, const std::vector<std::string>& arguments,
                 const std::function<bool()>& stopped);

}  // namespace weft::synth
