#include "synth/desk_scenes.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"
#include "synth/arrange.hpp"
#include "synth/sensor.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

constexpr int kVersion = 5;    // of the recipes: same version and settings, same bytes
constexpr int kTestEvery = 4;  // of the simulations of a state

}  // namespace

Random random_of(int seed, const std::string& purpose, int index) {
  Hash64 hash;
  hash.add(static_cast<std::uint64_t>(seed));
  hash.add(purpose);
  hash.add(static_cast<std::uint64_t>(index));
  return Random(hash.value());
}

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
      nlohmann::json{{"format", kind}, {"version", kVersion}, {"settings", settings}}.dump(1) +
      "\n";
  const fs::path file = out / "dataset.json";
  if (fs::exists(file) && read_text_file(file) != own) {
    throw Error(file.string() +
                ": this set was made with other settings or another version; choose another folder "
                "or the same settings");
  }
  write_text_file(file, own);
}

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
    out.push_back({path, s.name, s.garment, s.state, !s.parts.empty() && !s.turned_over,
                   ++seen[s.state] % kTestEvery == 0});
  }
  if (complete && out.empty())
    throw Error("every simulation had to be given up; see *.rejects.jsonl");
  return out;
}

void check_tshirts(const std::vector<Source>& sources) {
  const auto& names = coco_categories();
  for (const auto& each : sources) {
    if (std::find(names.begin(), names.end() - 1, each.state) == names.end() - 1) {
      throw Error(each.path + ": state " + each.state + " is not one of the six of T-shirts");
    }
  }
}

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

std::string kind_of(double pick, bool test) {
  if (pick < 0.35) return "single";
  if (pick < 0.65) return "apart";
  if (pick < 0.85 || !test) return "touching-different-colours";
  return "touching-same-colour";
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

Picture take(const RoomScene& scene, RoomView view, const ColourSensor& colour,
             const DepthSensor& depth, std::uint64_t seed) {
  view.baseline_m = depth.baseline_m;
  view.projector_sign = depth.projector_sign;
  const RoomImages images = scene.render(view);
  return {sense_colour(images.ideal.radiance, colour, seed),
          tum_depth(sense_depth(images.ideal, depth, scene.content().fabrics, seed)),
          images.instances};
}

std::string tum_pose(const CameraPose& pose) {
  Eigen::Matrix3d R_world_camera;
  R_world_camera << pose.right.cast<double>(), pose.down.cast<double>(),
      pose.forward.cast<double>();
  const Eigen::Quaterniond q(R_world_camera);
  return fmt::format("{:.6f} {:.6f} {:.6f} {:.7f} {:.7f} {:.7f} {:.7f}", pose.origin.x(),
                     pose.origin.y(), pose.origin.z(), q.x(), q.y(), q.z(), q.w());
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

}  // namespace weft::synth
