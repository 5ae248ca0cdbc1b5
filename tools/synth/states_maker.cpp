#include "synth/states_maker.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "synth/solid_mesh.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr int kTestEvery = 4;  // of the arrangements

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
  check_tshirts(sources);
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
          {"annotations", coco_annotations(p.labels, coco_instances(a), kMinInstancePixels)}};
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

}  // namespace weft::synth
