// Segments every scan of a folder: agreement with the data set's masks where it has them, time, and
// pictures to look at.
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"
#include "dataset/scene.hpp"
#include "foreground/foreground.hpp"

namespace {

double cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5)];
}

nlohmann::json summary(const std::vector<double>& values) {
  double sum = 0.0;
  for (double value : values) sum += value;
  return {{"count", values.size()},       {"mean", sum / static_cast<double>(values.size())},
          {"min", quantile(values, 0.0)}, {"p05", quantile(values, 0.05)},
          {"p50", quantile(values, 0.5)}, {"p95", quantile(values, 0.95)}};
}

/// The picture with what is table made red, and the truth's misses green.
cv::Mat overlay(const cv::Mat& colour, const cv::Mat& mask, const cv::Mat& truth) {
  cv::Mat picture = colour.clone();
  for (int v = 0; v < picture.rows; ++v)
    for (int u = 0; u < picture.cols; ++u) {
      auto& px = picture.at<cv::Vec3b>(v, u);
      const bool garment = mask.at<std::uint8_t>(v, u) != 0;
      const bool really = truth.empty() ? garment : truth.at<std::uint8_t>(v, u) != 0;
      if (!garment) px = px / 2 + (really ? cv::Vec3b(0, 127, 0) : cv::Vec3b(0, 0, 90));
      if (garment && !really) px = px / 2 + cv::Vec3b(127, 0, 127);
    }
  return picture;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Segments the scans of a folder and compares with its masks."};
  std::string folder, pictures, json_file, split;
  app.add_option("--dataset", folder, "folder of scans")->required();
  app.add_option("--split", split, "only scenes whose split begins so: train, test ...");
  app.add_option("--pictures", pictures, "folder for the masks drawn on the scans");
  app.add_option("--json", json_file, "results for scripts");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  try {
    if (!pictures.empty()) std::filesystem::create_directories(pictures);
    const auto scans = weft::dataset::open_dataset(folder);
    std::vector<double> times, all;
    std::map<std::string, std::vector<double>> by_garment;
    for (std::size_t i = 0; i < scans->names().size(); ++i) {
      weft::dataset::Scene scene = scans->read(i);
      if (scene.split.rfind(split, 0) != 0) continue;
      // The mask of a scene with two garments holds one of them.
      const cv::Mat truth = scene.single ? scene.frame.mask : cv::Mat();
      const double start = cpu_ms();
      const auto found = weft::foreground::find_foreground(scene.frame, {});
      times.push_back(cpu_ms() - start);
      std::printf("%-40s %5.1f ms  %s", scene.name.c_str(), times.back(),
                  found.table ? "" : "no table ");
      if (!truth.empty()) {
        const double iou = cv::countNonZero(found.mask & truth) /
                           std::max(1.0, static_cast<double>(cv::countNonZero(found.mask | truth)));
        all.push_back(iou);
        by_garment[scene.garment].push_back(iou);
        std::printf("IoU %.3f", iou);
      }
      std::printf("\n");
      if (!pictures.empty())
        cv::imwrite(pictures + "/" + scene.name + ".png",
                    overlay(scene.frame.colour, found.mask, truth));
    }
    if (times.empty()) throw weft::Error(folder + " holds no scene of split '" + split + "'");
    nlohmann::json result = {{"cpu_ms", summary(times)}};
    if (!all.empty()) result["iou"] = summary(all);
    for (const auto& [garment, values] : by_garment) result["garments"][garment] = summary(values);
    std::printf("%s\n", result.dump(1).c_str());
    if (!json_file.empty()) std::ofstream(json_file) << result.dump(1) << "\n";
  } catch (const std::exception& e) {
    std::fprintf(stderr, "weft-bench-foreground: %s\n", e.what());
    return 1;
  }
  return 0;
}
