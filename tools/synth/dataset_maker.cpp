#include "synth/dataset_maker.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <thread>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "dataset/iri.hpp"
#include "synth/annotate.hpp"
#include "synth/sensor.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

constexpr int kVersion = 5;  // of the recipe: same version and options, same bytes

struct Source {
  std::string path, name, garment, split, hash;
  bool held_out = false;
};

std::uint64_t draw_seed(const SynthOptions& options, const std::string& name, int purpose) {
  Hash64 hash;
  hash.add(static_cast<std::uint64_t>(options.seed));
  hash.add(name);
  hash.add(static_cast<std::uint64_t>(purpose));
  return hash.value();
}

std::string scene_name(const Source& source, int view) {
  return source.garment + "-" + source.name + "-v" + std::to_string(view);
}

void write_text(const fs::path& path, const std::string& text) {
  const std::string temporary = path.string() + ".tmp";
  std::ofstream out(temporary, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw Error(temporary + ": cannot be written; check the folder and the free space");
  fs::rename(temporary, path);
}

std::string read_text(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::vector<Source> list_sources(const std::string& folder, const SynthOptions& options,
                                 std::vector<std::string>& errors) {
  if (!fs::is_directory(folder)) throw Error(folder + ": not a folder of .wsim files");
  std::vector<std::string> paths;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() == ".wsim") paths.push_back(entry.path().string());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Source> sources;
  for (const auto& path : paths) {
    try {
      const Simulation s = read_simulation(path);
      Hash64 hash;
      hash.add(read_text(path));
      Source source{path, s.name, s.garment, "train", to_hex(hash.value()), s.held_out};
      if (s.held_out) {
        source.split = "test-held-out";
      } else if (Random(draw_seed(options, s.name, -1)).uniform() < options.test_share) {
        source.split = "test-seen";
      }
      sources.push_back(std::move(source));
    } catch (const Error& error) {
      errors.push_back(error.what());
    }
  }
  if (sources.empty()) {
    throw Error(folder + ": no .wsim file that can be read" +
                (errors.empty() ? "" : " (" + errors.front() + ")"));
  }
  return sources;
}

/// The second garment of a view, from the same split and earlier in the list, so that simulations
/// added later change nothing.
const Source* partner(const std::vector<Source>& sources, std::size_t index, Random& random) {
  std::vector<const Source*> candidates;
  for (std::size_t i = 0; i < index; ++i) {
    if (sources[i].split == sources[index].split && sources[i].garment != sources[index].garment) {
      candidates.push_back(&sources[i]);
    }
  }
  return candidates.empty() ? nullptr : candidates[random.below(candidates.size())];
}

bool is_finished(const fs::path& out, const std::string& name, const Source& source) {
  if (!fs::exists(out / "annotations" / (name + ".txt"))) return false;
  const auto meta =
      nlohmann::json::parse(read_text(out / "meta" / (name + ".json")), nullptr, false);
  return meta.is_object() && meta.value("simulation_hash", "") == source.hash;
}

nlohmann::json manifest_entry(const Source& source, const Simulation& s, const ViewRecipe& recipe,
                              const Annotation& annotation, const dataset::Scene& scene,
                              const Source* second) {
  using nlohmann::json;
  const auto round3 = [](double v) { return static_cast<double>(cvRound(v * 1000.0)) / 1000.0; };
  json parts = json::array();
  for (const auto& r : annotation.records) {
    parts.push_back({{"part", r.part},
                     {"instance", r.instance},
                     {"visible", round3(r.visible_share)},
                     {"inside", round3(r.inside_share)},
                     {"cut_off", round3(r.cut_off_share)},
                     {"pixels", r.pixels},
                     {"annotated", r.annotated},
                     {"ignore", r.ignore}});
  }
  const auto& c = recipe.camera;
  return {{"name", scene.name},
          {"simulation", source.name},
          {"simulation_hash", source.hash},
          {"second", second != nullptr ? json(second->name) : json(nullptr)},
          {"garment", s.garment},
          {"split", source.split},
          {"seed", s.seed},
          {"index", s.index},
          {"generator", s.generator},
          {"cut", json::parse(s.cut)},
          {"cut_held_out", s.held_out},
          {"state", s.state},
          {"turned_over", s.turned_over},
          {"wrinkledness", s.wrinkledness_deg},
          {"easy", scene.easy},
          {"single", scene.single},
          {"fabric", recipe.fabrics[0].family},
          {"fabric_held_out", recipe.fabrics[0].held_out},
          {"table", recipe.table.family},
          {"mirrored", recipe.mirrored},
          {"camera", {c.fx, c.fy, c.cx, c.cy}},
          {"height_m", round3(static_cast<double>(recipe.pose.origin.z()))},
          {"parts", parts}};
}

bool is_easy(const Simulation& s, const Annotation& annotation) {
  if (s.state == "crumpled" || s.wrinkledness_deg > 20.0) return false;
  bool any = false;
  for (const auto& r : annotation.records) {
    if (!r.annotated || r.ignore) continue;
    if (r.visible_share < 0.6) return false;
    any = true;
  }
  return any;
}

void render_scene(const Source& source, const Garment& garment, const Source* second,
                  const Garment* second_garment, Random& random, int view,
                  const SynthOptions& options, const std::string& out) {
  std::vector<const Garment*> garments = {&garment};
  std::vector<const Simulation*> simulations = {&garment.simulation};
  if (second_garment != nullptr) {
    garments.push_back(second_garment);
    simulations.push_back(&second_garment->simulation);
  }
  const ViewRecipe recipe = draw_view(random, simulations, source.held_out);
  const ViewScene view_scene(garments, recipe);
  const IdealImages images = view_scene.render(options.samples);
  const Annotation annotation = annotate(view_scene, images, recipe, garment.simulation, 0);

  dataset::Scene scene;
  scene.name = scene_name(source, view);
  scene.frame.camera = recipe.camera;
  if (recipe.mirrored) scene.frame.camera.cx = recipe.camera.width - 1 - recipe.camera.cx;
  scene.frame.colour = sense_colour(images.radiance, recipe.colour, recipe.sensor_seed);
  scene.frame.depth = sense_depth(images, recipe.depth, recipe.fabrics, recipe.sensor_seed);
  scene.frame.mask = images.object == 1;
  scene.polygons = annotation.polygons;
  scene.garment = garment.simulation.garment;
  scene.simulation = source.name;
  scene.split = source.split;
  scene.single = second == nullptr;
  scene.easy = scene.single && is_easy(garment.simulation, annotation);
  const auto entry =
      manifest_entry(source, garment.simulation, recipe, annotation, scene, second).dump();
  // The annotation says that a scene is finished: none while its files are of two kinds.
  fs::remove(fs::path(out) / "annotations" / (scene.name + ".txt"));
  write_text(fs::path(out) / "meta" / (scene.name + ".json"), entry + "\n");
  dataset::write_iri(out, scene, annotation.labels);
}

void check_folder(const std::string& out, SynthOptions options) {
  options.views = 1;  // more views add scenes and change none
  fs::create_directories(fs::path(out) / "meta");
  const nlohmann::json own = {{"format", "weft-synth"},
                              {"version", kVersion},
                              {"options", to_hex(options_hash(options))},
                              {"settings", options_to_yaml(options)}};
  const fs::path file = fs::path(out) / "dataset.json";
  if (fs::exists(file)) {
    if (read_text(file) != own.dump(1) + "\n") {
      throw Error(file.string() +
                  ": this data set was made with other options or another version; choose another "
                  "folder or the same options");
    }
    return;
  }
  write_text(file, own.dump(1) + "\n");
}

void write_manifest(const std::string& out) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(fs::path(out) / "meta")) {
    const auto name = entry.path().stem().string();
    if (entry.path().extension() == ".json" &&
        fs::exists(fs::path(out) / "annotations" / (name + ".txt"))) {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  std::string text;
  for (const auto& file : files) text += read_text(file);
  write_text(fs::path(out) / "manifest.jsonl", text);
}

}  // namespace

SynthProgress make_dataset(const std::string& simulations, const std::string& out,
                           const SynthOptions& options, int jobs,
                           const std::function<void(const SynthProgress&)>& report) {
  options.validate();
  std::vector<std::string> errors;
  const auto sources = list_sources(simulations, options, errors);
  check_folder(out, options);
  SynthProgress progress;
  progress.total = static_cast<int>(sources.size()) * options.views;
  const auto start = std::chrono::steady_clock::now();
  std::mutex mutex;
  const auto tell = [&](int SynthProgress::*counter, const std::string& what) {
    const std::lock_guard lock(mutex);
    ++(progress.*counter);
    progress.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    progress.last = what;
    report(progress);
  };
  for (const auto& error : errors) tell(&SynthProgress::failed, error);

  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < sources.size(); i = next++) {
      const Source& source = sources[i];
      std::optional<Garment> garment;
      for (int view = 0; view < options.views; ++view) {
        const std::string name = scene_name(source, view);
        if (is_finished(out, name, source)) {
          tell(&SynthProgress::skipped, name);
          continue;
        }
        try {
          if (!garment) garment = prepare_garment(read_simulation(source.path));
          Random random(draw_seed(options, source.name, view));
          const Source* second =
              random.uniform() < options.double_share ? partner(sources, i, random) : nullptr;
          std::optional<Garment> second_garment;
          if (second != nullptr) second_garment = prepare_garment(read_simulation(second->path));
          render_scene(source, *garment, second, second_garment ? &*second_garment : nullptr,
                       random, view, options, out);
          tell(&SynthProgress::done, name);
        } catch (const std::exception& error) {
          tell(&SynthProgress::failed, name + ": " + error.what());
        }
      }
    }
  };
  std::vector<std::thread> threads;
  for (int i = 1; i < jobs; ++i) threads.emplace_back(work);
  work();
  for (auto& thread : threads) thread.join();
  write_manifest(out);
  return progress;
}

void write_contact_sheet(const std::string& folder, const std::string& png, int count) {
  const auto dataset = dataset::open_iri(folder);
  const int total = static_cast<int>(dataset->names().size());
  count = std::min(count, total);
  constexpr int kColumns = 6, kWidth = 320, kHeight = 240;
  const int rows = (count + kColumns - 1) / kColumns;
  cv::Mat sheet(rows * kHeight, kColumns * kWidth, CV_8UC3, cv::Scalar::all(255));
  for (int k = 0; k < count; ++k) {
    const auto scene = dataset->read(static_cast<std::size_t>(k) * static_cast<std::size_t>(total) /
                                     static_cast<std::size_t>(count));
    cv::Mat picture = scene.frame.colour.clone();
    for (const auto& p : scene.polygons) {
      std::vector<cv::Point> points;
      for (const auto& q : p.points) points.emplace_back(cvRound(q.x), cvRound(q.y));
      cv::polylines(picture, points, true,
                    p.ignore ? cv::Scalar(128, 128, 128) : cv::Scalar(0, 255, 0), 2);
    }
    cv::putText(picture, scene.name, {6, 18}, cv::FONT_HERSHEY_SIMPLEX, 0.5, {0, 0, 255}, 1);
    cv::Mat small;
    cv::resize(picture, small, {kWidth, kHeight}, 0, 0, cv::INTER_AREA);
    small.copyTo(sheet(cv::Rect(k % kColumns * kWidth, k / kColumns * kHeight, kWidth, kHeight)));
  }
  if (!cv::imwrite(png, sheet)) throw Error(png + ": cannot be written");
}

}  // namespace weft::synth
