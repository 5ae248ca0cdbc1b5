#include "synth/dataset_maker.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"
#include "dataset/iri.hpp"
#include "synth/annotate.hpp"
#include "synth/sensor.hpp"
#include "synth/set_summary.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

constexpr int kVersion = 10;  // same version, settings and Blender: same bytes
constexpr int kMinVisible_px = 2500;
constexpr int kViewAttempts = 5;

struct Source {
  std::string path, name, garment, split, hash;
  bool held_out = false;
};

std::uint64_t draw_seed(const MakeOptions& options, const std::string& name, int purpose) {
  Hash64 hash;
  hash.add(static_cast<std::uint64_t>(options.seed));
  hash.add(name);
  hash.add(static_cast<std::uint64_t>(purpose));
  return hash.value();
}

std::string scene_name(const Source& source, int view) {
  return source.garment + "-" + source.name + "-v" + std::to_string(view);
}

Source read_source(const std::string& path, const MakeOptions& options) {
  const Simulation s = read_simulation(path);
  Hash64 hash;
  hash.add(read_text_file(path));
  Source source{path, s.name, s.garment, "train", to_hex(hash.value()), s.held_out};
  if (s.held_out) {
    source.split = "test-held-out";
  } else if (Random(draw_seed(options, s.name, -1)).uniform() < options.render.test_share) {
    source.split = "test-seen";
  }
  return source;
}

bool is_finished(const fs::path& out, const std::string& name, const Source& source) {
  if (!fs::exists(out / "annotations" / (name + ".txt"))) return false;
  const auto meta =
      nlohmann::json::parse(read_text_file(out / "meta" / (name + ".json")), nullptr, false);
  return meta.is_object() && meta.value("simulation_hash", "") == source.hash;
}

nlohmann::json manifest_entry(const Source& source, const Simulation& s, const ViewRecipe& recipe,
                              const Annotation& annotation, const dataset::Scene& scene,
                              const Source* second, const std::vector<std::string>& rejected) {
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
          {"rejected_views", rejected},
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

/// The folder's lock, for as long as the object lives; it leaves no file behind.
class FolderLock {
 public:
  explicit FolderLock(const std::string& folder)
      : file_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (file_ >= 0 && flock(file_, LOCK_EX | LOCK_NB) == 0) return;
    if (file_ >= 0) close(file_);
    throw Error(folder + ": another program is writing this data set; wait for it, or stop it");
  }
  ~FolderLock() { close(file_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int file_;
};

std::string describe(const MakeOptions& options) {
  const nlohmann::json json = {
      {"format", "weft-synth"}, {"version", kVersion}, {"settings", options.settings}};
  return json.dump(1) + "\n";
}

void check_folder(const std::string& out, const MakeOptions& options) {
  const fs::path file = fs::path(out) / "dataset.json";
  if (fs::exists(file)) {
    if (read_text_file(file) != describe(options)) {
      throw Error(file.string() +
                  ": this data set was made with other settings or another version; choose another "
                  "folder or the same settings");
    }
  } else {
    write_text_file(file, describe(options));
  }
  fs::create_directories(fs::path(out) / "meta");
  int there = 0;
  if (fs::is_directory(fs::path(out) / "annotations")) {
    for (const auto& entry : fs::directory_iterator(fs::path(out) / "annotations"))
      there += entry.path().extension() == ".txt" ? 1 : 0;
  }
  if (options.scenes > 0 && there > options.scenes) {
    throw Error(out + ": holds " + std::to_string(there) + " scenes, more than the " +
                std::to_string(options.scenes) +
                " asked for; ask for at least as many or choose another folder");
  }
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
  for (const auto& file : files) text += read_text_file(file);
  write_text_file(fs::path(out) / "manifest.jsonl", text);
}

/// One run: threads that take what is to be done next, a simulation or the views of one.
class Run {
 public:
  Run(SimulationSource& simulations, const std::string& out, const MakeOptions& options,
      const std::function<void(const SynthProgress&)>& report, const std::function<bool()>& stopped)
      : simulations_(simulations),
        out_(out),
        options_(options),
        report_(report),
        stopped_([this, &stopped] { return stopped() || failed_; }) {
    progress_.simulations_total = simulations.wanted();
    const int all = progress_.simulations_total * options.render.views;
    progress_.total = options.scenes > 0 ? options.scenes : all;
  }

  SynthProgress run() {
    std::vector<std::thread> threads;
    for (int i = 0; i < options_.jobs; ++i) threads.emplace_back([this] { work(); });
    for (auto& thread : threads) thread.join();
    if (error_) std::rethrow_exception(error_);
    progress_.stopped = stopped_();
    return progress_;
  }

 private:
  using Clock = std::chrono::steady_clock;

  void work() {
    try {
      std::unique_lock lock(mutex_);
      while (!stopped_()) {
        if (next_render_ < sources_.size()) {
          const std::size_t index = next_render_++;
          lock.unlock();
          render(index);
          lock.lock();
        } else if (progress_.simulations + running_ < progress_.simulations_total) {
          simulate(lock);
        } else if (running_ == 0) {
          return;
        } else {
          resolved_.wait_for(lock, std::chrono::milliseconds(200));
        }
      }
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!error_) error_ = std::current_exception();
      failed_ = true;
    }
    resolved_.notify_all();
  }

  void simulate(std::unique_lock<std::mutex>& lock) {
    const int index = next_simulation_++;
    // Rejected poses are a few percent; where nearly all are, there is no end to it.
    if (index > 3 * progress_.simulations_total + 20)
      throw Error("nearly every garment had to be given up; see the .rejects.jsonl files");
    ++running_;
    lock.unlock();
    const auto start = Clock::now();
    const auto path = simulations_.get(index, stopped_);
    std::optional<Source> source;
    if (path) source = read_source(*path, options_);
    const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
    lock.lock();
    --running_;
    if (stopped_()) return;
    // What was there already says nothing about the time that others take.
    if (seconds > 0.5) simulating_.add(seconds);
    ++(source ? progress_.simulations : progress_.given_up);
    outcomes_.emplace(index, std::move(source));
    for (auto next = outcomes_.find(next_outcome_); next != outcomes_.end();
         next = outcomes_.find(++next_outcome_)) {
      if (next->second) sources_.push_back(std::move(*next->second));
    }
    resolved_.notify_all();
    tell("");
  }

  /// The second garment of a view, from the same split and earlier in the list, so that simulations
  /// added later change nothing.
  const Source* partner(std::size_t index, Random& random) {
    const std::lock_guard lock(mutex_);
    std::vector<const Source*> candidates;
    for (std::size_t i = 0; i < index; ++i) {
      if (sources_[i].split == sources_[index].split &&
          sources_[i].garment != sources_[index].garment) {
        candidates.push_back(&sources_[i]);
      }
    }
    return candidates.empty() ? nullptr : candidates[random.below(candidates.size())];
  }

  const Source& source(std::size_t index) {
    const std::lock_guard lock(mutex_);
    return sources_[index];
  }

  void render(std::size_t index) {
    const Source& own = source(index);
    const int first = static_cast<int>(index) * options_.render.views;
    const int views = std::min(options_.render.views, progress_.total - first);
    std::optional<Garment> garment;
    for (int view = 0; view < views && !stopped_(); ++view) {
      const std::string name = scene_name(own, view);
      if (is_finished(out_, name, own)) {
        const std::lock_guard lock(mutex_);
        ++progress_.skipped;
        tell("");
        continue;
      }
      const auto start = Clock::now();
      std::string error;
      try {
        if (!garment) garment = prepare_garment(read_simulation(own.path));
        render_scene(index, own, *garment, view);
      } catch (const std::exception& e) {
        error = name + ": " + e.what();
      }
      const std::lock_guard lock(mutex_);
      rendering_.add(std::chrono::duration<double>(Clock::now() - start).count());
      ++(error.empty() ? progress_.done : progress_.failed);
      tell(error);
    }
  }

  void render_scene(std::size_t index, const Source& own, const Garment& garment, int view) {
    std::vector<std::string> rejected;
    for (int attempt = 0; attempt < kViewAttempts; ++attempt) {
      Random random(draw_seed(options_, own.name, view + 100 * attempt));
      const Source* second =
          random.uniform() < options_.render.double_share ? partner(index, random) : nullptr;
      std::optional<Garment> second_garment;
      std::vector<const Garment*> garments = {&garment};
      std::vector<const Simulation*> shown = {&garment.simulation};
      if (second != nullptr) {
        second_garment = prepare_garment(read_simulation(second->path));
        garments.push_back(&*second_garment);
        shown.push_back(&second_garment->simulation);
      }
      const ViewRecipe recipe = draw_view(random, shown, own.held_out);
      const ViewScene view_scene(garments, recipe);
      const IdealImages images = view_scene.render(options_.render.samples);
      if (cv::countNonZero(images.object == 1) < kMinVisible_px) {
        rejected.emplace_back("nothing visible");
        continue;
      }
      write_scene(own, garment.simulation, second, recipe, view_scene, images, view, rejected);
      return;
    }
    throw Error("next to nothing of the garment was visible in " + std::to_string(kViewAttempts) +
                " views");
  }

  void write_scene(const Source& own, const Simulation& simulation, const Source* second,
                   const ViewRecipe& recipe, const ViewScene& view_scene, const IdealImages& images,
                   int view, const std::vector<std::string>& rejected) const {
    const Annotation annotation = annotate(view_scene, images, recipe, simulation, 0);
    dataset::Scene scene;
    scene.name = scene_name(own, view);
    scene.frame.camera = recipe.camera;
    if (recipe.mirrored) scene.frame.camera.cx = recipe.camera.width - 1 - recipe.camera.cx;
    scene.frame.colour = sense_colour(images.radiance, recipe.colour, recipe.sensor_seed);
    scene.frame.depth = sense_depth(images, recipe.depth, recipe.fabrics, recipe.sensor_seed);
    scene.frame.mask = images.object == 1;
    scene.polygons = annotation.polygons;
    scene.garment = simulation.garment;
    scene.simulation = own.name;
    scene.split = own.split;
    scene.single = second == nullptr;
    scene.easy = scene.single && is_easy(simulation, annotation);
    const auto entry =
        manifest_entry(own, simulation, recipe, annotation, scene, second, rejected).dump();
    // The annotation says that a scene is finished: none while its files are of two kinds.
    fs::remove(fs::path(out_) / "annotations" / (scene.name + ".txt"));
    write_text_file(fs::path(out_) / "meta" / (scene.name + ".json"), entry + "\n");
    dataset::write_iri(out_, scene, annotation.labels);
  }

  void tell(const std::string& error) {  // with the lock held
    const int simulations = progress_.simulations_total - progress_.simulations;
    const int scenes = progress_.total - progress_.done - progress_.skipped - progress_.failed;
    const bool known = (simulations == 0 || simulating_.count > 0) && rendering_.count > 0;
    progress_.seconds_left =
        known ? (simulations * simulating_.mean() + scenes * rendering_.mean()) / options_.jobs
              : -1.0;
    progress_.error = error;
    report_(progress_);
  }

  struct Mean {
    double sum = 0.0;
    int count = 0;
    void add(double value) {
      sum += value;
      ++count;
    }
    double mean() const { return count > 0 ? sum / count : 0.0; }
  };

  SimulationSource& simulations_;
  const std::string out_;
  const MakeOptions& options_;
  const std::function<void(const SynthProgress&)>& report_;
  std::atomic<bool> failed_ = false;
  const std::function<bool()> stopped_;
  std::mutex mutex_;
  std::condition_variable resolved_;
  int next_simulation_ = 0, next_outcome_ = 0, running_ = 0;
  std::map<int, std::optional<Source>> outcomes_;
  std::deque<Source> sources_;  // in order, without gaps; a deque's elements stay where they are
  std::size_t next_render_ = 0;
  Mean simulating_, rendering_;
  SynthProgress progress_;
  std::exception_ptr error_;
};

}  // namespace

SynthProgress make_dataset(SimulationSource& simulations, const std::string& out,
                           const MakeOptions& options,
                           const std::function<void(const SynthProgress&)>& report,
                           const std::function<bool()>& stopped) {
  options.render.validate();
  fs::create_directories(out);
  const FolderLock lock(out);
  check_folder(out, options);
  auto progress = Run(simulations, out, options, report, stopped).run();
  if (progress.stopped) return progress;
  write_manifest(out);
  write_text_file(fs::path(out) / "summary.txt", summarise(out));
  write_contact_sheet(out);
  return progress;
}

}  // namespace weft::synth
