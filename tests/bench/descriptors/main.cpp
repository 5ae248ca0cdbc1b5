// Dense descriptors on several scans, each with its peer in the same run.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/project.hpp"
#include "bench/descriptors/bench.hpp"
#include "dataset/scene.hpp"
#include "support/table_scene.hpp"

namespace {

using namespace weft;         // NOLINT: a program
using namespace weft::bench;  // NOLINT

const std::vector<std::pair<std::string, nlohmann::json (*)(const Scan&, const Settings&)>>
    kBenches = {
        {"finddd", bench_finddd}, {"fpfh", bench_fpfh}, {"gdh", bench_gdh},
        {"hks", bench_hks},       {"sift", bench_sift}, {"words", bench_words},
};

// A wrinkled shirt on a table, with holes in the depth: there is always one scan.
rgbd::RgbdFrame shirt() {
  test::TableScene scene;
  scene.cloth_m = [](double x_m, double y_m) { return test::shirt_m(x_m, y_m); };
  scene.colour = [](double x_m, double y_m, bool cloth) {
    return cloth ? cv::Vec3d(90, 60, 150) + cv::Vec3d::all(30 * std::sin(150 * x_m + 90 * y_m))
                 : test::planks(x_m, y_m);
  };
  rgbd::RgbdFrame frame = scene.render();
  Random random(7);
  for (int hole = 0; hole < 60; ++hole) {
    const int width = 1 + static_cast<int>(random.below(12));
    const int height = 1 + static_cast<int>(random.below(12));
    const int x = static_cast<int>(random.below(static_cast<std::uint64_t>(640 - width)));
    const int y = static_cast<int>(random.below(static_cast<std::uint64_t>(480 - height)));
    frame.depth(cv::Rect(x, y, width, height)) = 0;
  }
  return frame;
}

// Scans by name: "shirt" and what lies in the folder of real recordings.
std::map<std::string, std::filesystem::path> known_scans() {
  std::map<std::string, std::filesystem::path> scans = {{"shirt", {}}};
  const char* variable = std::getenv("WEFT_DATA");
  std::filesystem::path data = variable ? variable : "";
  if (!variable) {
    // Beside the repository, wherever the build tree lies in it.
    try {
      data = std::filesystem::path(find_in_project("CMakePresets.json")).parent_path() /
             "../shared/data";
    } catch (const Error&) {
      return scans;
    }
  }
  for (const char* folder : {"pcl-scans", "uc3m-garments/pcd"}) {
    if (!std::filesystem::is_directory(data / folder)) continue;
    for (const auto& entry : std::filesystem::directory_iterator(data / folder)) {
      const std::string stem = entry.path().stem();
      if (entry.path().extension() == ".pcd" && !stem.ends_with("_keypoints"))
        scans[stem] = entry.path();
    }
  }
  return scans;
}

Scan load(const std::string& name, const std::filesystem::path& path) {
  Scan scan;
  scan.name = name;
  scan.frame = path.empty() ? shirt() : dataset::open_scan(path, "")->read(0).frame;
  const cv::Mat all(scan.frame.depth.size(), CV_8UC1, cv::Scalar(255));
  rgbd::ViewOptions sensor;
  sensor.rectified = false;
  scan.view = rgbd::make_view(scan.frame, all, nullptr, sensor);
  scan.images = {scan.frame.colour, all};
  scan.grid = descriptor::make_grid(scan.view.width, scan.view.height, {});
  return scan;
}

void print(const std::string& scan, const std::string& name, const nlohmann::json& row) {
  std::printf("%-28s %-8s %6d points %9.2f ms", scan.c_str(), name.c_str(),
              row["points"].get<int>(), row["ms"].get<double>());
  if (row["peer"].is_string()) {
    std::printf("   %9.2f ms   %7.2fx   %s", row["peer_ms"].get<double>(),
                row["ratio"].get<double>(), row["peer"].get<std::string>().c_str());
  }
  std::printf("\n");
  for (const auto& [key, value] : row.items()) {
    static const std::vector<std::string> kShown = {"points", "ms", "peer", "peer_ms", "ratio"};
    if (std::find(kShown.begin(), kShown.end(), key) != kShown.end() || value.is_null()) continue;
    if (value.is_array()) {
      for (const auto& each : value)
        std::printf("%37s %s %s\n", "", key.c_str(), each.dump().c_str());
    } else {
      std::printf("%37s %s %s\n", "", key.c_str(), value.dump().c_str());
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  keep_memory();
  CLI::App app{"Dense descriptors, each with its peer in the same run"};
  std::vector<std::string> names = {"shirt", "office1", "20150902_towel02_2_fold"};
  std::vector<std::string> descriptors;
  std::string json;
  Settings settings;
  bool no_peer = false, list = false;
  app.add_option("--scan", names,
                 "scans by a part of their name, or .pcd files; those of the default that are not "
                 "there are left out")
      ->capture_default_str();
  app.add_flag("--list", list, "names of the scans there are");
  app.add_option("--descriptor", descriptors, "only these")->check(CLI::IsMember([] {
    std::vector<std::string> all;
    for (const auto& [name, bench] : kBenches) all.push_back(name);
    return all;
  }()));
  app.add_option("--runs", settings.runs, "the fastest of so many runs counts")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  app.add_option("--threads", settings.threads)->check(CLI::Range(1, 64))->capture_default_str();
  app.add_flag("--no-peer", no_peer, "ours alone");
  app.add_option("--json", json, "write the results here");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  settings.peer = !no_peer;
  try {
    const auto known = known_scans();
    if (list) {
      for (const auto& [name, path] : known) std::printf("%s\n", name.c_str());
      return 0;
    }
    std::map<std::string, std::filesystem::path> chosen;
    for (const auto& name : names) {
      const auto before = chosen.size();
      if (name.ends_with(".pcd")) {
        chosen[std::filesystem::path(name).stem()] = name;
      } else if (known.contains(name)) {
        chosen[name] = known.at(name);
      } else {
        for (const auto& [stem, path] : known)
          if (stem.find(name) != std::string::npos) chosen[stem] = path;
      }
      if (chosen.size() > before) continue;
      if (app.count("--scan") > 0)
        throw Error("there is no scan '" + name +
                    "'; --list names them, WEFT_DATA is their folder");
      std::fprintf(stderr, "%s: not there, left out; set WEFT_DATA to the folder of recordings\n",
                   name.c_str());
    }
    nlohmann::json report;
    for (const auto& [name, path] : chosen) {
      const Scan scan = load(name, path);
      for (const auto& [descriptor, bench] : kBenches) {
        if (!descriptors.empty() &&
            std::find(descriptors.begin(), descriptors.end(), descriptor) == descriptors.end())
          continue;
        const auto row = bench(scan, settings);
        if (row.is_null()) continue;
        report[name][descriptor] = row;
        print(name, descriptor, row);
        std::fflush(stdout);
      }
    }
    if (!json.empty()) {
      std::ofstream file(json);
      file << report.dump(2) << "\n";
      if (!file.flush()) throw Error(json + ": cannot write");
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "weft-bench-descriptors: %s\n", e.what());
    return 1;
  }
  return 0;
}
