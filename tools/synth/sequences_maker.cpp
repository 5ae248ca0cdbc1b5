#include "synth/sequences_maker.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr int kFramesPerSecond = 30;

}  // namespace

CameraPath draw_path(Random& r) {
  CameraPath p;
  p.radius_m = r.uniform(1.25, 1.5);
  p.height_m = r.uniform(0.5, 0.8);
  p.speed_mps = r.uniform(0.2, 0.35);
  p.start = r.uniform(0.0, 2 * kPi);
  p.direction = r.uniform() < 0.5 ? 1.0 : -1.0;
  p.sway_m = r.uniform(0.05, 0.12);
  p.shake_m = r.uniform(0.0005, 0.003);
  for (auto& each : p.phase) each = r.uniform(0.0, 2 * kPi);
  return p;
}

CameraPose CameraPath::at(double t) const {
  const auto wave = [&](int k, double period) { return sine(2 * kPi * t / period + phase[k]); };
  const double angle = start + direction * speed_mps * t / radius_m;
  const double r = radius_m + sway_m * wave(0, 7.3);
  const Eigen::Vector3d origin(r * cosine(angle) + shake_m * wave(1, 0.41),
                               r * sine(angle) + shake_m * wave(2, 0.53),
                               height_m + sway_m * wave(3, 5.9) + shake_m * wave(4, 0.37));
  const Eigen::Vector3d target(2 * sway_m * wave(1, 6.7), 2 * sway_m * wave(2, 8.3),
                               2 * shake_m * wave(5, 0.61));
  return look_at(origin.cast<float>(), target.cast<float>(), Vec3::UnitZ());
}

ArmPath draw_arm_path(Random& r, const Eigen::Vector3d& target) {
  ArmPath p;
  p.target = target;
  p.height_m = r.uniform(0.75, 1.0);
  for (auto& each : p.reach_m) each = r.uniform(0.12, 0.25);
  for (auto& each : p.period_s) each = r.uniform(4.5, 8.0);
  p.lift_m = r.uniform(0.03, 0.08);
  p.turn = r.uniform(0.1, 0.5);
  p.yaw = r.uniform(0.0, 2 * kPi);
  p.shake_m = r.uniform(0.0003, 0.0015);
  for (auto& each : p.phase) each = r.uniform(0.0, 2 * kPi);
  return p;
}

CameraPose ArmPath::at(double t) const {
  const auto wave = [&](int k, double period) { return sine(2 * kPi * t / period + phase[k]); };
  const Eigen::Vector3d origin =
      target + Eigen::Vector3d(reach_m[0] * wave(0, period_s[0]) + shake_m * wave(3, 0.41),
                               reach_m[1] * wave(1, period_s[1]) + shake_m * wave(4, 0.53),
                               height_m + lift_m * wave(2, 6.1) + shake_m * wave(5, 0.37));
  const Eigen::Vector3d gaze =
      target + Eigen::Vector3d(0.05 * wave(2, 5.3), 0.05 * wave(0, 6.7), 0.0);
  const double angle = yaw + turn * wave(1, 9.1);
  return look_at(origin.cast<float>(), gaze.cast<float>(),
                 Eigen::Vector3d(cosine(angle), sine(angle), 0.0).cast<float>());
}

std::string tum_stamp(int frame) {
  const long us = (1'000'000L * frame + kFramesPerSecond / 2) / kFramesPerSecond;
  return fmt::format("{}.{:06d}", 1'700'000'000 + us / 1'000'000, us % 1'000'000);
}

namespace {

struct Sequence {
  std::function<CameraPose(double seconds)> path;
  rgbd::CameraModel camera;
  ColourSensor colour;
  DepthSensor depth;
  std::uint64_t noise_seed = 0;
};

Sequence draw_sequence(Random& r) {
  Sequence s;
  const CameraPath path = draw_path(r);
  s.path = [path](double t) { return path.at(t); };
  s.camera = draw_camera(r);
  draw_sensors(r, s.colour, s.depth);
  // A robot's cameras are set up with care: calibrated, exposed for the room, no soft lens.
  s.colour.mean_level = std::max(s.colour.mean_level, 0.3f);
  s.colour.bright_level = std::max(s.colour.bright_level, 0.9f);
  s.colour.blur_px = std::min(s.colour.blur_px, 0.7f);
  s.colour.vignetting = std::min(s.colour.vignetting, 0.2f);
  s.depth.shift_x_px = s.depth.shift_y_px = 0.0f;
  s.noise_seed = r.bits();
  return s;
}

/// Where the garments and their parts are, as the middle of the arm's sweep sees them.
json garments_file(const RoomScene& scene, const Arrangement& a, const Vec3& eye) {
  const auto place = [](const Vec3& p) {
    const auto rounded = [](float metres) { return std::round(1e5 * metres) / 1e5; };
    return json{rounded(p.x()), rounded(p.y()), rounded(p.z())};
  };
  json garments = json::array();
  for (std::size_t g = 0; g < a.garments.size(); ++g) {
    const Simulation& simulation = a.garments[g]->simulation;
    Vec3 middle = Vec3::Zero();
    for (const auto& vertex : simulation.pose)
      middle += a.content.placements[g].apply(vertex) / static_cast<float>(simulation.pose.size());
    json parts = json::array();
    const auto seen = scene.parts_seen_from(eye, g);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      if (seen[i].seen_m2 <= 0.0) continue;
      parts.push_back({{"part", simulation.parts[i].part},
                       {"instance", simulation.parts[i].instance},
                       {"position_m", place(seen[i].centre)},
                       {"seen_share", std::round(1e3 * seen[i].seen_m2 / seen[i].area_m2) / 1e3}});
    }
    garments.push_back({{"label", g + 1},
                        {"garment", simulation.garment},
                        {"simulation", simulation.name},
                        {"state", simulation.state},
                        {"position_m", place(middle)},
                        {"parts", parts}});
  }
  return {{"garments", garments}};
}

void write_instances(const fs::path& out, int frames, const Arrangement& a) {
  std::vector<json> images;
  const auto instances = coco_instances(a);
  for (int k = 0; k < frames; ++k) {
    const std::string stamp = tum_stamp(k);
    const cv::Mat labels =
        cv::imread((out / "masks" / (stamp + ".png")).string(), cv::IMREAD_UNCHANGED);
    images.push_back({{"image",
                       {{"file_name", "rgb/" + stamp + ".png"},
                        {"width", labels.cols},
                        {"height", labels.rows},
                        {"timestamp", stamp}}},
                      {"annotations", coco_annotations(labels, instances, kMinInstancePixels)}});
  }
  write_text_file(out / "instances.json", coco_file(images, "Weft sequence").dump() + "\n");
}

void write_lists(const fs::path& out, const Sequence& s, int frames) {
  std::string rgb = "# color images\n# timestamp filename\n",
              depth = "# depth maps, 5000 a metre\n# timestamp filename\n", associations,
              truth =
                  "# pose of the colour camera (x right, y down, z forward) in the desk's frame "
                  "(z up)\n# timestamp tx ty tz qx qy qz qw\n";
  for (int k = 0; k < frames; ++k) {
    const std::string stamp = tum_stamp(k);
    rgb += fmt::format("{0} rgb/{0}.png\n", stamp);
    depth += fmt::format("{0} depth/{0}.png\n", stamp);
    associations += fmt::format("{0} rgb/{0}.png {0} depth/{0}.png\n", stamp);
    truth += stamp + " " + tum_pose(s.path(static_cast<double>(k) / kFramesPerSecond)) + "\n";
  }
  const auto& c = s.camera;
  write_text_file(
      out / "camera.yaml",
      fmt::format("# pinhole camera of rgb/ and depth/, without distortion\n"
                  "width: {}\nheight: {}\nfx: {:.6f}\nfy: {:.6f}\ncx: {:.6f}\ncy: {:.6f}\n"
                  "fps: {}\ndepth_factor: 5000  # units a metre\n",
                  c.width, c.height, c.fx, c.fy, c.cx, c.cy, kFramesPerSecond));
  write_text_file(out / "rgb.txt", rgb);
  write_text_file(out / "depth.txt", depth);
  write_text_file(out / "associations.txt", associations);
  write_text_file(out / "groundtruth.txt", truth);  // says that the sequence is finished
}

std::vector<Source> flat_with_parts(const std::vector<Source>& sources) {
  std::vector<Source> out;
  for (const auto& each : sources)
    if (each.shows_parts && (each.state == "flat" || each.state == "wrinkled")) out.push_back(each);
  if (out.empty()) {
    throw Error(
        "view above: no simulation with parts lies flat or wrinkled, face up; give "
        "--simulations a folder of weft synth parts that has one");
  }
  return out;
}

}  // namespace

StatesProgress make_sequences(SimulationSource& simulations, const std::string& folder,
                              const SequencesRecipe& recipe, const std::string& settings, int jobs,
                              const StatesReport& report, const std::function<bool()>& stopped) {
  recipe.validate();
  check_folder(folder, "weft-synth-sequences", settings);
  StatesProgress result;
  result.stage = "sequences";
  result.total = recipe.scenes;
  bool complete = false;
  const auto sources = get_simulations(simulations, jobs, report, stopped, complete);
  result.given_up = simulations.wanted() - static_cast<int>(sources.size());
  result.stopped = !complete;
  const bool above = recipe.view == SequencesRecipe::View::kAbove;
  const auto usable = above ? flat_with_parts(sources) : sources;
  if (complete && !above) check_tshirts(sources);
  const int frames = std::max(1, static_cast<int>(recipe.seconds * kFramesPerSecond));
  for (int i = 0; i < recipe.scenes && !result.stopped; ++i) {
    const fs::path out = fs::path(folder) / fmt::format("sequence-{:03d}", i);
    if (!fs::exists(out / "groundtruth.txt")) {
      for (const char* each : {"rgb", "depth", "masks"}) fs::create_directories(out / each);
      Random r = random_of(recipe.seed, "sequence", i);
      Sequence sequence = draw_sequence(r);
      const std::string kind = kind_of(r.uniform(), true);
      const Arrangement a = draw_arrangement(r, usable, above ? "single" : kind, true, false);
      const RoomScene scene(a.content);
      const Vec2& middle = a.content.placements[0].offset;
      if (above) {
        const ArmPath path = draw_arm_path(r, {middle.x(), middle.y(), 0.0});
        sequence.path = [path](double t) { return path.at(t); };
        write_text_file(
            out / "garments.json",
            garments_file(scene, a,
                          (path.target + path.height_m * Eigen::Vector3d::UnitZ()).cast<float>())
                    .dump(1) +
                "\n");
      }
      const auto render = [&](int k) {
        const std::string file = tum_stamp(k) + ".png";
        if (fs::exists(out / "masks" / file)) return;
        RoomView view;
        view.samples = recipe.samples;
        view.camera = sequence.camera;
        view.pose = sequence.path(static_cast<double>(k) / kFramesPerSecond);
        const Picture p = take(scene, view, sequence.colour, sequence.depth,
                               sequence.noise_seed + static_cast<std::uint64_t>(k));
        write_png(out / "rgb" / file, p.colour);
        write_png(out / "depth" / file, p.depth);
        write_png(out / "masks" / file, p.labels);
      };
      if (!run_all("frames", frames, jobs, render, report, stopped)) {
        result.stopped = true;
        break;
      }
      if (!above) write_instances(out, frames, a);
      write_lists(out, sequence, frames);
    }
    ++result.done;
  }
  return result;
}

}  // namespace weft::synth
