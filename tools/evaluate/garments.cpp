#include "evaluate/garments.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "dataset/sequence.hpp"
#include "evaluation/garment_metrics.hpp"
#include "evaluation/trajectory_metrics.hpp"
#include "mapping/map_log.hpp"

namespace weft::evaluate {

void add_options(CLI::App& app, GarmentsCommand& command) {
  app.add_option("log", command.log,
                 "log of a set with garments in its map, such as config/sets/parts-map.yaml")
      ->required();
  app.add_option("--truth", command.truth,
                 "folder of the recording: true poses, and garments.json as weft synth sequences "
                 "--set view=above writes it")
      ->required();
  app.add_option("--suffix", command.suffix, "a variant's, such as @mine");
  app.add_option("--settings", command.settings_file, "YAML file of settings");
  app.add_option("--set", command.assignments,
                 "key=value: max_garment_distance_m, max_part_distance_m, min_seen_share, "
                 "min_probability");
  app.add_option("--json", command.json, "file for the figures");
}

int evaluate_garments_command(const GarmentsCommand& command) {
  auto settings = command.settings_file.empty() ? Settings::empty("command line")
                                                : Settings::from_file(command.settings_file);
  for (const auto& assignment : command.assignments) settings.set(assignment);
  evaluation::GarmentOptions options;
  settings.read(options);
  const auto file = std::filesystem::path(command.truth) / "garments.json";
  if (!std::filesystem::exists(file))
    throw Error(file.string() + " is not there: the recording does not say where its garments are");
  const auto truth = dataset::read_garment_truth(file.string());
  const auto sequence = dataset::open_sequence(command.truth);
  if (sequence.truth.empty()) throw Error(command.truth + ": the recording has no true poses");

  const auto log = mapping::read_map_log(command.log, command.suffix);
  const auto path = log.path(true);
  if (path.empty()) throw Error(command.log + ": no frame is tracked in its last map");
  const auto trajectory = evaluation::evaluate_trajectory(path, sequence.truth, {});
  const Eigen::Isometry3d& T = trajectory.T_truth_estimate;
  const slam::Rigid3d T_truth_world{Eigen::Quaterniond(T.linear()), T.translation()};
  std::vector<slam::Garment> found;
  for (const auto& garment : log.garments)
    found.push_back(evaluation::transformed(garment, T_truth_world));

  const auto evaluation = evaluation::evaluate_garments(truth, found, options);
  std::printf("camera within %.1f cm of its true path (RMSE)\n%s", 100.0 * trajectory.ate_m.rmse,
              evaluation::to_table(evaluation, truth).c_str());
  if (!command.json.empty()) {
    auto json = evaluation::to_json(evaluation, truth);
    json["ate_rmse_m"] = trajectory.ate_m.rmse;
    write_text_file(command.json, json.dump(1) + "\n");
  }
  return 0;
}

}  // namespace weft::evaluate
