#include "synth/states_maker.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"
#include "synth/arrange.hpp"
#include "synth/coco.hpp"
#include "synth/sensor.hpp"
#include "synth/solid_mesh.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr int kVersion = 5;  // of the recipe: same version and settings, same bytes
constexpr int kFramesPerSecond = 30;
constexpr int kMinPixels = 64;  // of an annotated instance
constexpr int kTestEvery = 4;   // of the simulations of a state, and of the arrangements

struct Source {
  std::string path, name, state;
  bool test = false;
};

Random random_of(int seed, const std::string& purpose, int index) {
  Hash64 hash;
  hash.add(static_cast<std::uint64_t>(seed));
  hash.add(purpose);
  hash.add(static_cast<std::uint64_t>(index));
  return Random(hash.value());
}

/// Runs work(0) to work(count - 1) on `jobs` threads; the first error ends it and is thrown.
/// False when stopped() did.
bool run_all(const char* stage, int count, int jobs, const std::function<void(int)>& work,
             const StatesReport& report, const std::function<bool()>& stopped) {
  std::atomic<int> next{0};
  std::atomic<bool> failed{false};
  std::mutex mutex;
  std::string error;
  StatesProgress progress;
  progress.stage = stage;
  progress.total = count;
  const auto start = std::chrono::steady_clock::now();
  const auto loop = [&] {
    for (int i = next++; i < count && !failed && !stopped(); i = next++) {
      try {
        work(i);
      } catch (const std::exception& e) {
        const std::lock_guard lock(mutex);
        if (!failed) error = e.what();
        failed = true;
        return;
      }
      const std::lock_guard lock(mutex);
      ++progress.done;
      const double seconds =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      progress.seconds_left = seconds / progress.done * (count - progress.done);
      report(progress);
    }
  };
  std::vector<std::thread> threads;
  for (int i = 1; i < jobs; ++i) threads.emplace_back(loop);
  loop();
  for (auto& thread : threads) thread.join();
  if (failed) throw Error(error);
  return progress.done == count;
}

void write_png(const fs::path& path, const cv::Mat& image) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", image, bytes)) throw Error(path.string() + ": cannot be encoded");
  write_text_file(path, std::string(bytes.begin(), bytes.end()));
}

void check_folder(const fs::path& out, const std::string& kind, const std::string& settings) {
  fs::create_directories(out);
  const std::string own =
      json{{"format", kind}, {"version", kVersion}, {"settings", settings}}.dump(1) + "\n";
  const fs::path file = out / "dataset.json";
  if (fs::exists(file) && read_text_file(file) != own) {
    throw Error(file.string() +
                ": this set was made with other settings or another version; choose another folder "
                "or the same settings");
  }
  write_text_file(file, own);
}

/// Simulations in their order; test: every fourth of a state.
std::vector<Source> get_simulations(SimulationSource& simulations, int jobs,
                                    const StatesReport& report,
                                    const std::function<bool()>& stopped, bool& complete) {
  std::vector<std::string> paths(static_cast<std::size_t>(simulations.wanted()));
  complete = run_all(
      "simulations", simulations.wanted(), jobs,
      [&](int i) { paths[static_cast<std::size_t>(i)] = simulations.get(i, stopped).value_or(""); },
      report, stopped);
  complete = complete && !stopped();
  std::vector<Source> out;
  std::map<std::string, int> seen;
  for (const auto& path : paths) {
    if (path.empty()) continue;
    const Simulation s = read_simulation(path);
    const auto& names = coco_categories();
    if (std::find(names.begin(), names.end() - 1, s.state) == names.end() - 1) {
      throw Error(path + ": state " + s.state + " is not one of the six of T-shirts");
    }
    out.push_back({path, s.name, s.state, ++seen[s.state] % kTestEvery == 0});
  }
  if (complete && out.empty())
    throw Error("every simulation had to be given up; see *.rejects.jsonl");
  return out;
}

/// What lies on a desk, drawn; owns its garments.
struct Arrangement {
  std::vector<std::unique_ptr<Garment>> garments;
  std::vector<const Source*> sources;
  std::string kind;
  RoomContent content;
};

Arrangement draw_arrangement(Random& r, const std::vector<Source>& sources, const std::string& kind,
                             bool any_split, bool test) {
  std::vector<const Source*> usable;
  for (const auto& s : sources) {
    if (any_split || s.test == test) usable.push_back(&s);
  }
  Arrangement a;
  a.kind = kind;
  // States come up equally often, however many simulations each has.
  std::map<std::string, std::vector<const Source*>> by_state;
  for (const auto* s : usable) by_state[s->state].push_back(s);
  for (int round = 0;; ++round) {
    if (round == 200) throw Error("no arrangement fits on a desk; are the simulations T-shirts?");
    a.content.room = draw_room(r);
    a.sources.clear();
    std::vector<Simulation> simulations;
    // Large ones are hard to place: ask for fewer after many failures.
    const int most = round < 40 ? 6 : (round < 120 ? 3 : 2);
    const int count = kind == "single" ? 1 : static_cast<int>(r.integer(2, most));
    for (int i = 0; i < count; ++i) {
      auto state = by_state.begin();
      std::advance(state, static_cast<long>(r.below(by_state.size())));
      a.sources.push_back(state->second[r.below(state->second.size())]);
      simulations.push_back(read_simulation(a.sources.back()->path));
    }
    std::vector<const Simulation*> list;
    for (const auto& s : simulations) list.push_back(&s);
    const auto placements = arrange(r, list, a.content.room.desk_top,
                                    kind == "apart" ? Neighbours::kApart : Neighbours::kTouching);
    if (!placements) continue;
    a.content.placements = *placements;
    a.content.fabrics =
        draw_fabrics(r, list, a.content.room.desk_colour(), kind == "touching-same-colour",
                     kind == "touching-different-colours");
    for (auto& s : simulations) {
      a.garments.push_back(std::make_unique<Garment>(prepare_garment(std::move(s))));
    }
    break;
  }
  for (const auto& g : a.garments) a.content.garments.push_back(g.get());
  a.content.lighting = draw_lighting(r, Vec3(0.3f, 0.2f, 1.0f));
  return a;
}

/// How T-shirts lie, for a number of [0, 1).
std::string kind_of(double pick, bool test) {
  if (pick < 0.35) return "single";
  if (pick < 0.65) return "apart";
  if (pick < 0.85 || !test) return "touching-different-colours";
  return "touching-same-colour";
}

/// Where the paper's data set (section 3.2) has such an image: the first of its versions v1 to v4
/// that holds it, and the test subset's name.
struct Subset {
  int version;
  std::string name;
};
constexpr int kVersions = 4;
constexpr const char* kSubsets[] = {"v1", "v2c", "v3ma", "v3mcd", "v3mcs", "v4sd"};

Subset subset_of(bool top, const Arrangement& a) {
  if (!top) return {4, "v4sd"};
  if (a.kind == "single") {
    const std::string& fabric = a.content.fabrics[0].family;
    return fabric == "plain" || fabric == "logo" ? Subset{1, "v1"} : Subset{2, "v2c"};
  }
  if (a.kind == "apart") return {3, "v3ma"};
  return {3, a.kind == "touching-same-colour" ? "v3mcs" : "v3mcd"};
}

rgbd::CameraModel draw_camera(Random& r) {
  rgbd::CameraModel c;
  c.width = 640;
  c.height = 480;
  c.fx = c.fy = r.uniform() < 0.3 ? 525.0 : r.uniform(500.0, 600.0);
  c.cx = 319.5 + r.uniform(-5.0, 5.0);
  c.cy = 239.5 + r.uniform(-5.0, 5.0);
  return c;
}

std::vector<CocoInstance> coco_instances(const Arrangement& a) {
  std::vector<CocoInstance> out;
  for (std::size_t i = 0; i < a.sources.size(); ++i) {
    out.push_back({static_cast<int>(i) + 1, a.sources[i]->state, a.sources[i]->name});
  }
  out.push_back({kDeskInstance, "desk", a.content.room.desk_kind});
  return out;
}

/// Pose of a still camera: over the desk, or where a robot beside it would have it.
CameraPose draw_still(Random& r, bool top, const RoomContent& content) {
  Vec2 middle = Vec2::Zero();
  for (const auto& p : content.placements) {
    middle += p.offset / static_cast<float>(content.placements.size());
  }
  const auto u = [&](double a, double b) { return static_cast<float>(r.uniform(a, b)); };
  const double angle = r.uniform(0.0, 2 * kPi);
  const Vec3 way(static_cast<float>(cosine(angle)), static_cast<float>(sine(angle)), 0.0f);
  const Vec3 target(middle.x() + u(-0.12, 0.12), middle.y() + u(-0.12, 0.12), 0.0f);
  if (top) {
    const float height = content.garments.size() > 1 ? u(1.1, 1.9) : u(0.8, 1.5);
    return look_at(target + Vec3(u(-0.08, 0.08), u(-0.08, 0.08), height), target, way);
  }
  const Vec3 origin = way * u(1.0, 1.7) + Vec3(0, 0, u(0.4, 1.0));
  return look_at(origin, target, Vec3::UnitZ());
}

struct Picture {
  cv::Mat colour, depth, labels;
};

Picture take(const RoomScene& scene, RoomView view, const ColourSensor& colour,
             const DepthSensor& depth, std::uint64_t seed) {
  view.baseline_m = depth.baseline_m;
  view.projector_sign = depth.projector_sign;
  const RoomImages images = scene.render(view);
  return {sense_colour(images.ideal.radiance, colour, seed),
          tum_depth(sense_depth(images.ideal, depth, scene.content().fabrics, seed)),
          images.instances};
}

void write_meshes(const fs::path& out, const std::vector<Source>& sources,
                  const StatesRecipe& recipe, int index) {
  const auto step = static_cast<float>(0.001 * recipe.mesh_step_mm);
  if (index < kDeskKinds) {
    Random r = random_of(recipe.seed, "desk", index);
    const Room room = draw_room(r, index);
    const fs::path file = out / "meshes/desk" / (room.desk_kind + ".obj");
    if (fs::exists(file)) return;
    write_obj(file.string(), unite(room.desk(), 0.012f),
              fmt::format("desk {}, its top at z = 0", room.desk_kind));
    return;
  }
  const Source& source = sources[static_cast<std::size_t>(index - kDeskKinds)];
  const fs::path file = out / "meshes" / source.state / (source.name + ".obj");
  if (fs::exists(file)) return;
  const Simulation s = read_simulation(source.path);
  Surface cloth;
  cloth.position = s.pose;
  cloth.pattern = s.pattern;
  cloth.faces = s.faces;
  cloth.panel_of_face = s.panel_of_face;
  compute_normals(cloth);
  smooth(cloth, 2, 8);
  std::vector<std::array<int, 2>> parents;
  cloth = subdivide(cloth, parents);
  write_obj(file.string(), thicken(cloth, 0.9f * step, step),
            fmt::format("T-shirt, {}, simulation {}, all points within {:.1f} mm of the cloth",
                        source.state, source.name, 0.9 * recipe.mesh_step_mm));
}

/// Four of each state from above, a row for each.
void write_contact_sheet(const fs::path& file, const std::vector<Source>& sources, int jobs,
                         int seed, const StatesReport& report,
                         const std::function<bool()>& stopped) {
  constexpr int kColumns = 4, kWidth = 480, kHeight = 360;
  struct Cell {
    const Source* source;
    int row, column;
  };
  std::vector<Cell> cells;
  const auto& states = coco_categories();
  for (std::size_t row = 0; row + 1 < states.size(); ++row) {
    int column = 0;
    for (const auto& s : sources) {
      if (s.state == states[row] && column < kColumns)
        cells.push_back({&s, static_cast<int>(row), column++});
    }
  }
  cv::Mat sheet((static_cast<int>(states.size()) - 1) * kHeight, kColumns * kWidth, CV_8UC3,
                cv::Scalar::all(255));
  const bool complete = run_all(
      "pictures of the contact sheet", static_cast<int>(cells.size()), jobs,
      [&](int i) {
        const Cell& cell = cells[static_cast<std::size_t>(i)];
        Random r = random_of(seed, "sheet " + cell.source->name, 0);
        Arrangement a = draw_arrangement(r, {*cell.source}, "single", true, false);
        a.content.placements[0] = Placement{};
        const RoomScene scene(a.content);
        RoomView view;
        view.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
        view.pose = look_at(Vec3(0.0f, -0.1f, 0.95f), Vec3::Zero(), Vec3::UnitY());
        ColourSensor colour;
        Picture p = take(scene, view, colour, DepthSensor{}, 1);
        cv::putText(p.colour, cell.source->state + "  " + cell.source->name, {8, 24},
                    cv::FONT_HERSHEY_SIMPLEX, 0.7, {0, 0, 255}, 2);
        cv::Mat small;
        cv::resize(p.colour, small, {kWidth, kHeight}, 0, 0, cv::INTER_AREA);
        small.copyTo(sheet(cv::Rect(cell.column * kWidth, cell.row * kHeight, kWidth, kHeight)));
      },
      report, stopped);
  if (complete) write_png(file, sheet);
}

std::string counts_text(const std::map<std::string, int>& counts) {
  std::string text;
  for (const auto& [name, count] : counts) text += fmt::format("  {:28} {}\n", name, count);
  return text;
}

/// Rejected poses by state and reason, from the simulator's notes.
std::string rejects_text(const std::vector<Source>& sources) {
  std::map<std::string, int> counts;
  std::vector<fs::path> files;
  if (!sources.empty()) {
    for (const auto& entry : fs::directory_iterator(fs::path(sources[0].path).parent_path())) {
      if (entry.path().string().ends_with(".rejects.jsonl")) files.push_back(entry.path());
    }
  }
  for (const auto& file : files) {
    std::istringstream lines(read_text_file(file));
    for (std::string line; std::getline(lines, line);) {
      const auto entry = json::parse(line, nullptr, false);
      if (entry.is_object()) ++counts[entry.value("state", "") + ": " + entry.value("reason", "")];
    }
  }
  return counts.empty() ? "" : "rejected poses\n" + counts_text(counts);
}

}  // namespace

ArrangementPlan plan_arrangement(int index, bool any_test) {
  const int earlier_tests = any_test ? index / kTestEvery : 0;
  const bool test = any_test && index % kTestEvery == kTestEvery - 1;
  const int number = test ? earlier_tests : index - earlier_tests;
  // Multiples of the golden ratio: any run of them is spread evenly over [0, 1).
  const double pick = 0.6180339887498949 * number;
  return {test, kind_of(pick - std::floor(pick), test)};
}

StatesProgress make_states(SimulationSource& simulations, const std::string& folder,
                           const StatesRecipe& recipe, const std::string& settings, int jobs,
                           const StatesReport& report, const std::function<bool()>& stopped) {
  recipe.validate();
  const fs::path out = folder;
  check_folder(out, "weft-synth-states", settings);
  for (const char* each : {"images", "depth", "labels", "meta", "annotations", "meshes/desk"})
    fs::create_directories(out / each);
  StatesProgress result;
  result.stage = "images";
  result.total = recipe.scenes;
  bool complete = false;
  const auto sources = get_simulations(simulations, jobs, report, stopped, complete);
  result.given_up = simulations.wanted() - static_cast<int>(sources.size());
  result.stopped = !complete;
  if (!complete) return result;
  std::map<std::string, int> states;
  for (const auto& s : sources) {
    fs::create_directories(out / "meshes" / s.state);
    ++states[s.state];
  }
  if (!run_all(
          "meshes", kDeskKinds + static_cast<int>(sources.size()), jobs,
          [&](int i) { write_meshes(out, sources, recipe, i); }, report, stopped)) {
    result.stopped = true;
    return result;
  }

  const auto name_of = [](int image) { return fmt::format("{:06d}", image); };
  const auto meta_of = [&](int image) { return out / "meta" / (name_of(image) + ".json"); };
  const int arrangements = (recipe.scenes + recipe.views - 1) / recipe.views;
  const bool any_test =
      std::any_of(sources.begin(), sources.end(), [](const Source& s) { return s.test; });
  const auto render = [&](int index) {
    const int first = index * recipe.views, last = std::min(recipe.scenes, first + recipe.views);
    bool finished = true;
    for (int i = first; i < last; ++i) finished = finished && fs::exists(meta_of(i));
    if (finished) return;
    Random r = random_of(recipe.seed, "arrangement", index);
    const ArrangementPlan plan = plan_arrangement(index, any_test);
    const bool test = plan.test;
    const Arrangement a = draw_arrangement(r, sources, plan.kind, false, test);
    const RoomScene scene(a.content);
    for (int i = first; i < last; ++i) {
      if (fs::exists(meta_of(i))) continue;
      Random view_random = random_of(recipe.seed, "view", i);
      RoomView view;
      view.samples = recipe.samples;
      view.camera = draw_camera(view_random);
      const bool top = view_random.uniform() < 0.5;
      view.pose = draw_still(view_random, top, a.content);
      ColourSensor colour;
      DepthSensor depth;
      draw_sensors(view_random, colour, depth);
      const Picture p = take(scene, view, colour, depth, view_random.bits());
      const std::string file = name_of(i) + ".png";
      write_png(out / "images" / file, p.colour);
      write_png(out / "depth" / file, p.depth);
      write_png(out / "labels" / file, p.labels);
      const auto& c = view.camera;
      const Subset subset = subset_of(top, a);
      json fabrics = json::array();
      for (const auto& fabric : a.content.fabrics) fabrics.push_back(fabric.family);
      const json meta = {
          {"image",
           {{"file_name", file},
            {"width", c.width},
            {"height", c.height},
            {"camera", {c.fx, c.fy, c.cx, c.cy}},
            {"pose", tum_pose(view.pose)},
            {"view", top ? "top" : "beside"},
            {"arrangement", index},
            {"kind", a.kind},
            {"fabrics", fabrics},
            {"split", test ? "test" : "train"},
            {"version", subset.version},
            {"subset", subset.name}}},
          {"annotations", coco_annotations(p.labels, coco_instances(a), kMinPixels)}};
      write_text_file(meta_of(i), meta.dump() + "\n");
    }
  };
  if (!run_all("arrangements", arrangements, jobs, render, report, stopped)) {
    result.stopped = true;
    return result;
  }

  std::map<std::string, std::vector<json>> files = {{"train", {}}, {"test", {}}};
  for (int v = 1; v < kVersions; ++v) files[fmt::format("train-v{}", v)];
  for (const auto* name : kSubsets) files[std::string("test-") + name];
  std::map<std::string, int> instances, kinds;
  for (int i = 0; i < recipe.scenes; ++i) {
    const json meta = json::parse(read_text_file(meta_of(i)));
    const auto& image = meta["image"];
    const std::string split = image["split"];
    ++kinds[fmt::format("{} {} {}", split, image["view"].get<std::string>(),
                        image["kind"].get<std::string>())];
    for (const auto& each : meta["annotations"])
      ++instances[split + " " + coco_categories()[each["category_id"].get<std::size_t>() - 1]];
    files.at(split).push_back(meta);
    if (split == "test") {
      files.at("test-" + image["subset"].get<std::string>()).push_back(meta);
    } else {
      for (int v = image["version"]; v < kVersions; ++v)
        files.at(fmt::format("train-v{}", v)).push_back(meta);
    }
  }
  for (const auto& [name, images] : files) {
    write_text_file(out / "annotations" / ("instances_" + name + ".json"),
                    coco_file(images, "Weft T-shirt states, " + name).dump() + "\n");
  }
  if (!fs::exists(out / "contact-sheet.png")) {
    write_contact_sheet(out / "contact-sheet.png", sources, jobs, recipe.seed, report, stopped);
  }
  write_text_file(out / "summary.txt",
                  fmt::format("simulations ({} given up)\n{}images\n{}instances\n{}{}",
                              result.given_up, counts_text(states), counts_text(kinds),
                              counts_text(instances), rejects_text(sources)));
  result.done = recipe.scenes;
  result.stopped = stopped();
  return result;
}

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

std::string tum_pose(const CameraPose& pose) {
  Eigen::Matrix3d R_world_camera;
  R_world_camera << pose.right.cast<double>(), pose.down.cast<double>(),
      pose.forward.cast<double>();
  const Eigen::Quaterniond q(R_world_camera);
  return fmt::format("{:.6f} {:.6f} {:.6f} {:.7f} {:.7f} {:.7f} {:.7f}", pose.origin.x(),
                     pose.origin.y(), pose.origin.z(), q.x(), q.y(), q.z(), q.w());
}

std::string tum_stamp(int frame) {
  const long us = (1'000'000L * frame + kFramesPerSecond / 2) / kFramesPerSecond;
  return fmt::format("{}.{:06d}", 1'700'000'000 + us / 1'000'000, us % 1'000'000);
}

cv::Mat tum_depth(const cv::Mat& depth_mm) {
  cv::Mat out(depth_mm.size(), CV_16UC1);
  for (int y = 0; y < out.rows; ++y) {
    for (int x = 0; x < out.cols; ++x)
      out.at<std::uint16_t>(y, x) =
          cv::saturate_cast<std::uint16_t>(5 * depth_mm.at<std::uint16_t>(y, x));
  }
  return out;
}

namespace {

struct Sequence {
  CameraPath path;
  rgbd::CameraModel camera;
  ColourSensor colour;
  DepthSensor depth;
  std::uint64_t noise_seed = 0;
};

Sequence draw_sequence(Random& r) {
  Sequence s;
  s.path = draw_path(r);
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

void write_lists(const fs::path& out, const Sequence& s, int frames, const Arrangement& a) {
  std::string rgb = "# color images\n# timestamp filename\n",
              depth = "# depth maps, 5000 a metre\n# timestamp filename\n", associations,
              truth =
                  "# pose of the colour camera (x right, y down, z forward) in the desk's frame "
                  "(z up)\n# timestamp tx ty tz qx qy qz qw\n";
  std::vector<json> images;
  const auto instances = coco_instances(a);
  for (int k = 0; k < frames; ++k) {
    const std::string stamp = tum_stamp(k);
    rgb += fmt::format("{0} rgb/{0}.png\n", stamp);
    depth += fmt::format("{0} depth/{0}.png\n", stamp);
    associations += fmt::format("{0} rgb/{0}.png {0} depth/{0}.png\n", stamp);
    truth += stamp + " " + tum_pose(s.path.at(static_cast<double>(k) / kFramesPerSecond)) + "\n";
    const cv::Mat labels =
        cv::imread((out / "masks" / (stamp + ".png")).string(), cv::IMREAD_UNCHANGED);
    images.push_back({{"image",
                       {{"file_name", "rgb/" + stamp + ".png"},
                        {"width", labels.cols},
                        {"height", labels.rows},
                        {"timestamp", stamp}}},
                      {"annotations", coco_annotations(labels, instances, kMinPixels)}});
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
  write_text_file(out / "instances.json", coco_file(images, "Weft sequence").dump() + "\n");
  write_text_file(out / "groundtruth.txt", truth);  // says that the sequence is finished
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
  const int frames = std::max(1, static_cast<int>(recipe.seconds * kFramesPerSecond));
  for (int i = 0; i < recipe.scenes && !result.stopped; ++i) {
    const fs::path out = fs::path(folder) / fmt::format("sequence-{:03d}", i);
    if (!fs::exists(out / "groundtruth.txt")) {
      for (const char* each : {"rgb", "depth", "masks"}) fs::create_directories(out / each);
      Random r = random_of(recipe.seed, "sequence", i);
      const Sequence sequence = draw_sequence(r);
      const Arrangement a = draw_arrangement(r, sources, kind_of(r.uniform(), true), true, false);
      const RoomScene scene(a.content);
      const auto render = [&](int k) {
        const std::string file = tum_stamp(k) + ".png";
        if (fs::exists(out / "masks" / file)) return;
        RoomView view;
        view.samples = recipe.samples;
        view.camera = sequence.camera;
        view.pose = sequence.path.at(static_cast<double>(k) / kFramesPerSecond);
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
      write_lists(out, sequence, frames, a);
    }
    ++result.done;
  }
  return result;
}

}  // namespace weft::synth
