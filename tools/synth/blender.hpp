#pragma once

#include <functional>
#include <string>
#include <vector>

namespace weft::synth {

/// Path of the program blender. Throws Error with the remedy where it is not installed.
std::string find_blender();

/// "Blender 3.4.1": what the program says of itself. Other versions simulate other folds.
std::string blender_version();

enum class BlenderEnd { kDone, kStopped, kCrashed };

/// Runs `blender SCRIPT -- ARGUMENTS` headless, in one thread (with more, results change from run
/// to run) and waits for it. It is killed once stopped() says so, and dies with this program.
/// kCrashed: a fault of its own ended it, such as SIGSEGV. Throws Error with the last lines of its
/// output when it fails in any other way.
BlenderEnd run_blender(const std::string& script, const std::vector<std::string>& arguments,
                       const std::function<bool()>& stopped);

}  // namespace weft::synth
