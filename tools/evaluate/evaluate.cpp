#include "evaluate/evaluate.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "dataset/augment.hpp"
#include "evaluate/garments.hpp"
#include "evaluate/judge.hpp"
#include "evaluate/planes.hpp"
#include "evaluate/trajectory.hpp"
#include "evaluation/part_picture.hpp"
#include "evaluation/part_report.hpp"

namespace weft::evaluate {
namespace {

struct PartsCommand {
  std::string dataset, models = "config/models/parts-sift", log, channel = "PART_DETECTIONS", json,
                       pictures, settings_file;
  std::vector<std::string> assignments;
  Selection selection;
  dataset::AugmentOptions augment;
  bool live = false;
  double threshold = 0.5;
  int threads = 0;
};

void add_options(CLI::App& app, PartsCommand& command) {
  app.add_option("--dataset", command.dataset, "folder with the truth")->required();
  app.add_option("--models", command.models, "folder of models to run on the dataset")
      ->capture_default_str();
  app.add_option("--log", command.log, "judge the detections of this log instead");
  app.add_option("--channel", command.channel, "channel of the log's detections")
      ->capture_default_str();
  app.add_option("--split", command.selection.split, "only scenes of this split, e.g. test-seen");
  app.add_option("--scene", command.selection.scenes, "only these scenes");
  app.add_flag("--easy", command.selection.easy, "only the Easy subset");
  app.add_flag("--several", command.selection.several, "also scenes with several garments");
  app.add_option("--rotations", command.augment.rotations,
                 "show each scene in so many rotations, evenly spread");
  app.add_flag("--mirror", command.augment.mirror, "show each of them mirrored as well");
  app.add_flag("--live", command.live, "segment the garment, even where the dataset has masks");
  app.add_option("--settings", command.settings_file, "YAML file of detector settings");
  app.add_option("--set", command.assignments, "key=value, e.g. score.peaks.max_peaks=5");
  app.add_option("--json", command.json, "file for the scores");
  app.add_option("--pictures", command.pictures, "folder for pictures of detections and truth");
  app.add_option("--threshold", command.threshold,
                 "probability from which on a detection counts as sure; right ones are told apart")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--threads", command.threads, "0: one for each core");
}

int evaluate_parts(const PartsCommand& command) {
  command.augment.validate();
  const auto data = dataset::augment(dataset::open_dataset(command.dataset), command.augment);
  if (!command.pictures.empty()) std::filesystem::create_directories(command.pictures);
  const Observer observer =
      command.pictures.empty()
          ? Observer()
          : [&](const evaluation::JudgedImage& image, const cv::Mat& colour) {
              const auto path = command.pictures + "/" + image.name + ".jpg";
              if (!cv::imwrite(path, evaluation::draw_parts(colour, image.truth, image.detections,
                                                            command.threshold))) {
                throw Error("cannot write " + path);
              }
            };
  int shown = -1;
  const Report report = [&](int done, int total) {
    const int percent = total > 0 ? 100 * done / total : 100;
    if (percent / 5 == shown / 5 && shown >= 0) return;
    shown = percent;
    std::fprintf(stderr, "%3d %%\n", percent);
  };
  const Note note = [](const std::string& text) {
    std::fprintf(stderr, "note: %s\n", text.c_str());
  };

  nlohmann::json json;
  int failed = 0;
  std::size_t images = 0;
  if (command.log.empty()) {
    auto settings = command.settings_file.empty() ? Settings::empty("command line")
                                                  : Settings::from_file(command.settings_file);
    for (const auto& assignment : command.assignments) settings.set(assignment);
    detector::DetectorOptions options;
    settings.read(options);
    options.prior = detector::PriorMode::kOff;
    const detector::Detector detector(detector::ModelBundle::read(command.models), options);
    const int threads = command.threads > 0 ? command.threads
                                            : static_cast<int>(std::thread::hardware_concurrency());
    const auto judged = judge_dataset(*data, detector, command.selection, command.live, threads,
                                      failed, report, note, observer);
    if (judged.empty()) throw Error("no scene of the dataset is selected");
    images = judged.at("off").size();
    for (const char* mode : {"off", "soft", "hard"}) {
      const auto evaluation = evaluation::evaluate_parts(judged.at(mode), command.threshold);
      std::printf("prior %s\n%s\n", mode, evaluation::to_table(evaluation).c_str());
      json["modes"][mode] = evaluation::to_json(evaluation);
    }
    json.update(json["modes"]["off"]);
    json["models"] = {{"folder", command.models}, {"hash", to_hex(detector.bundle().hash)}};
  } else {
    const auto judged = judge_log(command.log, command.channel, *data, command.selection, failed,
                                  report, note, observer);
    images = judged.size();
    const auto evaluation = evaluation::evaluate_parts(judged, command.threshold);
    std::printf("%s\n", evaluation::to_table(evaluation).c_str());
    json = evaluation::to_json(evaluation);
    json["log"] = command.log;
  }
  json["images"] = images;
  json["failed"] = failed;
  if (!command.json.empty()) write_text_file(command.json, json.dump(1) + "\n");
  if (failed > 0) {
    std::fprintf(stderr, "%d images failed\n", failed);
    return 1;
  }
  return 0;
}

}  // namespace

int run_evaluate(int argc, char** argv) {
  CLI::App app{"Evaluates models and logs against annotated datasets."};
  app.require_subcommand(1);
  PartsCommand command;
  auto* parts = app.add_subcommand(
      "parts", "recall at 1, 3, 5 and average precision of garment part detections");
  add_options(*parts, command);
  TrajectoryCommand trajectory;
  auto* trajectory_app = app.add_subcommand(
      "trajectory", "absolute and relative errors of a camera path against the truth");
  add_options(*trajectory_app, trajectory);
  PlanesCommand planes;
  auto* planes_app =
      app.add_subcommand("planes", "extracted planes against depth images with labelled ones");
  add_options(*planes_app, planes);
  GarmentsCommand garments;
  auto* garments_app =
      app.add_subcommand("garments", "garments and parts in the map against where they truly are");
  add_options(*garments_app, garments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    if (trajectory_app->parsed()) return evaluate_trajectory_command(trajectory);
    if (garments_app->parsed()) return evaluate_garments_command(garments);
    if (planes_app->parsed()) return evaluate_planes_command(planes);
    return evaluate_parts(command);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "weft evaluate: %s\n", error.what());
    return 1;
  }
}

}  // namespace weft::evaluate
