#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

/// `weft evaluate trajectory`
namespace weft::evaluate {

struct TrajectoryCommand {
  std::string estimate;  // TUM file, or a log of CAMERA_POSE
  std::string truth;     // TUM file, or the folder of a recording
  std::string suffix, out, json, settings_file;
  bool live = false;  // of a log: poses as they were said, not as the map has corrected them
  std::vector<std::string> assignments;
  std::size_t frames = 0;  // of the recording; 0: not known, as many as the truth has poses
};

void add_options(CLI::App& app, TrajectoryCommand& command);

/// Throws Error; the exit status is 0.
int evaluate_trajectory_command(const TrajectoryCommand& command);

}  // namespace weft::evaluate
