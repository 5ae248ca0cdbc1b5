// weft bench slam: tracking and mapping of a recording in one thread, with each part on and off.
#include <fmt/format.h>
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "dataset/sequence.hpp"
#include "evaluation/trajectory_metrics.hpp"
#include "slam/pipeline.hpp"

namespace weft {
namespace {

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

struct Times {
  std::vector<double> features, planes, track, map, frame;
};

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

dataset::Trajectory to_trajectory(const std::vector<slam::CameraPath::Pose>& poses) {
  dataset::Trajectory out;
  for (const auto& pose : poses) {
    const auto T_world_camera = pose.T_camera_world.inverse();
    out.push_back({pose.utime, T_world_camera.rotation, T_world_camera.translation});
  }
  return out;
}

struct Command {
  std::string folder, out, settings, vocabulary, json;
  std::vector<std::string> assignments;
  std::size_t first = 0, frames = 0;
  int every = 1;
  bool no_planes = false, verbose = false;
};

nlohmann::json run(const Command& c, const dataset::Sequence& sequence,
                   slam::PipelineOptions options, bool planes) {
  if (!planes) options.without_planes();
  std::shared_ptr<const slam::BinaryVocabulary> vocabulary;
  if (!c.vocabulary.empty())
    vocabulary =
        std::make_shared<slam::BinaryVocabulary>(slam::BinaryVocabulary::read(c.vocabulary));
  slam::Pipeline pipeline(options, vocabulary);
  Times times;
  int tracked = 0, lost = 0, key_frames = 0;
  const std::size_t end =
      c.frames == 0 ? sequence.frames.size() : std::min(sequence.frames.size(), c.first + c.frames);
  std::size_t frames = 0;
  for (std::size_t i = c.first; i < end; i += static_cast<std::size_t>(c.every)) {
    ++frames;
    const auto images = sequence.read(i);
    slam::FrameInput input;
    input.frame = static_cast<std::int64_t>(i);
    input.utime = sequence.frames[i].utime;
    input.camera = images.camera;
    const double t0 = cpu_ms();
    input.features = pipeline.see_features(images);
    const double t1 = cpu_ms();
    if (planes) input.planes = pipeline.see_planes(images);
    const double t2 = cpu_ms();
    const auto result = pipeline.track(input);
    const double t3 = cpu_ms();
    pipeline.map(result);
    const double t4 = cpu_ms();
    times.features.push_back(t1 - t0);
    if (planes) times.planes.push_back(t2 - t1);
    times.track.push_back(t3 - t2);
    if (result.key_frame) times.map.push_back(t4 - t3);
    times.frame.push_back(t4 - t0);
    if (result.state == slam::TrackingState::kTracked) ++tracked;
    if (result.state == slam::TrackingState::kLost) ++lost;
    if (result.key_frame) ++key_frames;
    if (c.verbose || result.state == slam::TrackingState::kLost || !result.reason.empty())
      fmt::print("  frame {}: {} {} points {} planes of {} and {}{} {}\n", i,
                 result.state == slam::TrackingState::kTracked ? "tracked," : "NOT TRACKED,",
                 result.points, result.planes, input.features.size(), input.planes.size(),
                 result.key_frame
                     ? result.key_frame->new_plane ? ", key frame (new plane)" : ", key frame"
                     : "",
                 result.reason);
  }
  pipeline.finish();
  const auto path = to_trajectory(pipeline.path().poses(pipeline.map()));
  const auto live = to_trajectory(pipeline.path().live());
  nlohmann::json out = {{"planes", planes},
                        {"frames", frames},
                        {"tracked", tracked},
                        {"lost", lost},
                        {"key_frames", pipeline.map().key_frames.size()},
                        {"points", pipeline.map().points.size()},
                        {"map_planes", pipeline.map().planes.size()}};
  const auto add_times = [&](const char* name, const std::vector<double>& t) {
    out["cpu_ms"][name] = {
        {"mean", mean(t)}, {"p50", quantile(t, 0.5)}, {"p95", quantile(t, 0.95)}};
  };
  add_times("features", times.features);
  add_times("planes", times.planes);
  add_times("track", times.track);
  add_times("map_key_frame", times.map);
  add_times("frame", times.frame);
  const std::string mode = planes ? "planes" : "points";
  if (!c.out.empty()) {
    std::filesystem::create_directories(c.out);
    dataset::write_trajectory(c.out + "/" + mode + ".txt", path);
    dataset::write_trajectory(c.out + "/" + mode + "-live.txt", live);
  }
  if (sequence.truth.size() > 5) {
    evaluation::TrajectoryOptions judged;
    const auto final_errors = evaluation::evaluate_trajectory(path, sequence.truth, judged);
    const auto live_errors = evaluation::evaluate_trajectory(live, sequence.truth, judged);
    out["ate_rmse_m"] = final_errors.ate_m.rmse;
    out["ate_max_m"] = final_errors.ate_m.max;
    out["rotation_rmse_deg"] = final_errors.rotation_deg.rmse;
    out["ate_rmse_live_m"] = live_errors.ate_m.rmse;
    out["rpe_trans_m"] = final_errors.rpe_translation_m.rmse;
  } else if (sequence.truth.size() > 1) {
    evaluation::TrajectoryOptions judged;
    const auto errors = evaluation::evaluate_trajectory(path, sequence.truth, judged);
    out["pair_max_m"] = errors.pair_translation_m.max;
    out["pair_max_deg"] = errors.pair_rotation_deg.max;
  }
  fmt::print(
      "{} {}: {} of {} frames tracked, {} lost; {} key frames asked, {} kept, {} points, "
      "{} planes\n",
      sequence.name, planes ? "points and planes" : "points alone", tracked, frames, lost,
      key_frames, pipeline.map().key_frames.size(), pipeline.map().points.size(),
      pipeline.map().planes.size());
  for (const char* key : {"ate_rmse_m", "ate_max_m", "ate_rmse_live_m", "rotation_rmse_deg",
                          "rpe_trans_m", "pair_max_m", "pair_max_deg"})
    if (out.contains(key)) fmt::print("  {} {:.4f}\n", key, out[key].get<double>());
  for (const auto& [name, t] : out["cpu_ms"].items())
    fmt::print("  {:14} CPU ms mean {:6.1f}  p50 {:6.1f}  p95 {:6.1f}\n", name,
               t["mean"].get<double>(), t["p50"].get<double>(), t["p95"].get<double>());
  return out;
}

int main_of(int argc, char** argv) {
  CLI::App app("tracking and mapping of a recording in one thread", "weft bench slam");
  Command c;
  app.add_option("folder", c.folder, "recording: TUM, 7-Scenes, ICL-NUIM or cube_slam layout")
      ->required();
  app.add_option("--vocabulary", c.vocabulary, "vocabulary.blob; default: none");
  app.add_option("--settings", c.settings, "YAML of PipelineOptions");
  app.add_option("--set", c.assignments, "KEY=VALUE of the settings");
  app.add_option("--first", c.first, "frame to begin with");
  app.add_option("--frames", c.frames, "frames to take at most");
  app.add_option("--every", c.every, "take every n-th frame")->check(CLI::Range(1, 1000));
  app.add_option("--out", c.out, "folder for the paths found");
  app.add_option("--json", c.json, "file for the figures");
  app.add_flag("--verbose", c.verbose, "say something of every frame");
  std::string mode = "both";
  app.add_option("--mode", mode, "planes, points or both")
      ->check(CLI::IsMember({"planes", "points", "both"}));
  CLI11_PARSE(app, argc, argv);
  const auto sequence = dataset::open_sequence(c.folder);
  slam::PipelineOptions options;
  auto settings =
      c.settings.empty() ? Settings::empty("command line") : Settings::from_file(c.settings);
  for (const auto& assignment : c.assignments) settings.set(assignment);
  settings.read(options);
  nlohmann::json out = {{"recording", sequence.name}};
  if (mode != "points") out["with_planes"] = run(c, sequence, options, true);
  if (mode != "planes") out["without_planes"] = run(c, sequence, options, false);
  if (!c.json.empty()) write_text_file(c.json, out.dump(2) + "\n");
  return 0;
}

}  // namespace
}  // namespace weft

int main(int argc, char** argv) {
  try {
    return weft::main_of(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "weft bench slam: %s\n", e.what());
    return 1;
  }
}
