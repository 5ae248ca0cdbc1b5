#include "evaluate/trajectory.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "evaluation/trajectory_metrics.hpp"

namespace weft::evaluate {

void add_options(CLI::App& app, TrajectoryCommand& command) {
  app.add_option("estimate", command.estimate,
                 "file of camera poses in the TUM format: stamp tx ty tz qx qy qz qw")
      ->required();
  app.add_option("--truth", command.truth, "true poses in the TUM format")->required();
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
  const auto truth = dataset::read_trajectory(command.truth);
  const auto estimate = dataset::read_trajectory(command.estimate);
  const auto evaluation = evaluation::evaluate_trajectory(estimate, truth, options);
  const std::size_t frames = command.frames > 0 ? command.frames : truth.size();
  std::printf("%s", evaluation::to_table(evaluation, frames).c_str());
  if (!command.json.empty()) {
    std::ofstream out(command.json);
    out << evaluation::to_json(evaluation, frames).dump(1) << '\n';
    if (!out) throw Error("cannot write " + command.json);
  }
  return 0;
}

}  // namespace weft::evaluate
