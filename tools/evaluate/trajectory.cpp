#include "evaluate/trajectory.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "dataset/sequence.hpp"
#include "evaluation/trajectory_metrics.hpp"
#include "mapping/map_log.hpp"

namespace weft::evaluate {
namespace {

/// frames: of the recording, where it is one and none was given.
dataset::Trajectory read_truth(const std::string& path, std::size_t& frames) {
  if (!std::filesystem::is_directory(path)) return dataset::read_trajectory(path);
  const auto sequence = dataset::open_sequence(path);
  if (sequence.truth.empty()) throw Error(path + ": the recording has no true poses");
  if (frames == 0) frames = sequence.frames.size();
  return sequence.truth;
}

/// LCM logs begin with a sync word, text does not.
bool is_log(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  char sync[4] = {};
  return in.read(sync, 4) && std::string(sync, 4) == "\xed\xa1\xda\x01";
}

dataset::Trajectory read_estimate(const TrajectoryCommand& command, std::size_t& frames,
                                  nlohmann::json& tracking) {
  if (!is_log(command.estimate)) return dataset::read_trajectory(command.estimate);
  const auto log = mapping::read_map_log(command.estimate, command.suffix);
  if (frames == 0) frames = static_cast<std::size_t>(log.frames);
  std::size_t tracked = 0, lost = 0, not_started = 0, other_maps = 0;
  for (const auto& pose : log.poses) {
    using State = slam::TrackingState;
    tracked += pose.tracked.state == State::kTracked;
    lost += pose.tracked.state == State::kLost;
    not_started += pose.tracked.state == State::kNotStarted;
    other_maps += pose.tracked.state == State::kTracked && pose.map_id != log.map_id;
  }
  tracking = {{"frames", log.frames},
              {"tracked", tracked},
              {"lost", lost},
              {"not_started", not_started},
              {"maps", log.map_ids.size()},
              {"in_other_maps", other_maps},
              {"key_frames", log.map.key_frames.size()},
              {"points", log.map.points.size()},
              {"planes", log.map.planes.size()}};
  std::printf("%zu tracked, %zu lost, %zu not started; %zu map%s%s\n", tracked, lost, not_started,
              log.map_ids.size(), log.map_ids.size() == 1 ? "" : "s",
              other_maps > 0 ? (", of " + std::to_string(other_maps) +
                                " poses in another than the last, which do not count")
                                   .c_str()
                             : "");
  auto path = log.path(!command.live);
  if (path.empty()) throw Error(command.estimate + ": no frame is tracked in its last map");
  return path;
}

}  // namespace

void add_options(CLI::App& app, TrajectoryCommand& command) {
  app.add_option("estimate", command.estimate,
                 "log with CAMERA_POSE and MAP_UPDATE, or a file of camera poses in the TUM "
                 "format: stamp tx ty tz qx qy qz qw")
      ->required();
  app.add_option("--truth", command.truth,
                 "true poses in the TUM format, or the folder of a recording that has them")
      ->required();
  app.add_flag("--live", command.live,
               "of a log: poses as they were said frame by frame; without it, as the map's key "
               "frames have been moved since");
  app.add_option("--suffix", command.suffix, "of a log: a variant's, such as @mine");
  app.add_option("--out", command.out, "write the compared poses here, in the TUM format");
  app.add_option("--frames", command.frames,
                 "frames of the recording; default: as many as the truth has poses");
  app.add_option("--settings", command.settings_file, "YAML file of settings");
  app.add_option("--set", command.assignments,
                 "key=value: max_time_difference_s, alignment (se3, first, none), rpe_step, "
                 "segment_lengths_m");
  app.add_option("--json", command.json, "file for the figures");
}

int evaluate_trajectory_command(const TrajectoryCommand& command) {
  auto settings = command.settings_file.empty() ? Settings::empty("command line")
                                                : Settings::from_file(command.settings_file);
  for (const auto& assignment : command.assignments) settings.set(assignment);
  evaluation::TrajectoryOptions options;
  settings.read(options);
  std::size_t frames = command.frames;
  const auto truth = read_truth(command.truth, frames);
  nlohmann::json tracking;
  const auto estimate = read_estimate(command, frames, tracking);
  const auto evaluation = evaluation::evaluate_trajectory(estimate, truth, options);
  if (frames == 0) frames = truth.size();
  std::printf("%s", evaluation::to_table(evaluation, frames).c_str());
  if (!command.out.empty()) dataset::write_trajectory(command.out, estimate);
  if (!command.json.empty()) {
    auto json = evaluation::to_json(evaluation, frames);
    if (!tracking.is_null()) json["tracking"] = tracking;
    write_text_file(command.json, json.dump(1) + "\n");
  }
  return 0;
}

}  // namespace weft::evaluate
