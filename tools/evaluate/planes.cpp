#include "evaluate/planes.hpp"

#include <CLI/CLI.hpp>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "dataset/plane_scans.hpp"
#include "evaluation/plane_metrics.hpp"
#include "plane/extractor.hpp"

namespace weft::evaluate {
namespace {

double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180.0 / std::numbers::pi;
}

/// Sums over scans of one kind, and the errors of their matched planes.
struct Tally {
  int scans = 0, truths = 0, segments = 0, matched = 0;
  double iou = 0.0, area_iou = 0.0;
  std::vector<double> angles_deg, distances_m;

  void add(const evaluation::PlaneSegmentation& s) {
    ++scans;
    truths += s.truths;
    segments += s.segments;
    matched += s.matched;
    iou += s.mean_iou * s.truths;
    area_iou += s.area_iou;
  }
  nlohmann::json json() const {
    const auto share = [](double a, double b) { return b > 0 ? a / b : 0.0; };
    const auto within = [&](const std::vector<double>& errors, double limit) {
      return std::count_if(errors.begin(), errors.end(), [&](double e) { return e <= limit; });
    };
    const auto largest = [](const std::vector<double>& errors) {
      return errors.empty() ? 0.0 : *std::max_element(errors.begin(), errors.end());
    };
    return {{"scans", scans},
            {"truths", truths},
            {"segments", segments},
            {"matched", matched},
            {"precision", share(matched, segments)},
            {"recall", share(matched, truths)},
            {"mean_iou", share(iou, truths)},
            {"area_iou", share(area_iou, scans)},
            {"compared", angles_deg.size()},
            {"within_1_deg", within(angles_deg, 1.0)},
            {"within_1_cm", within(distances_m, 0.01)},
            {"max_angle_deg", largest(angles_deg)},
            {"max_distance_m", largest(distances_m)}};
  }
};

void print(const std::string& name, const Tally& tally) {
  const auto j = tally.json();
  std::printf(
      "%-34s %5d %5d %5d   %5.1f %5.1f %5.1f %5.1f   %3d of %3zu %6.2f   %3d of %3zu %7.2f\n",
      name.c_str(), tally.truths, tally.segments, tally.matched,
      100.0 * j["precision"].get<double>(), 100.0 * j["recall"].get<double>(),
      100.0 * j["mean_iou"].get<double>(), 100.0 * j["area_iou"].get<double>(),
      j["within_1_deg"].get<int>(), tally.angles_deg.size(), j["max_angle_deg"].get<double>(),
      j["within_1_cm"].get<int>(), tally.distances_m.size(),
      1000.0 * j["max_distance_m"].get<double>());
}

/// Truth above, segments below, a colour a label.
cv::Mat picture(const cv::Mat& truth, const cv::Mat& labels) {
  const auto colour = [](int label) {
    if (label == 0) return cv::Vec3b(0, 0, 0);
    const auto channel = [&](int k) { return static_cast<uchar>(64 + (label * k) % 192); };
    return cv::Vec3b(channel(53), channel(97), channel(151));
  };
  cv::Mat out(2 * truth.rows, truth.cols, CV_8UC3);
  for (int v = 0; v < truth.rows; ++v)
    for (int u = 0; u < truth.cols; ++u) {
      out.at<cv::Vec3b>(v, u) = colour(truth.at<std::uint8_t>(v, u));
      out.at<cv::Vec3b>(v + truth.rows, u) = colour(labels.at<std::uint8_t>(v, u));
    }
  return out;
}

}  // namespace

void add_options(CLI::App& app, PlanesCommand& command) {
  app.add_option("--dataset", command.dataset,
                 "folder of depth images with labelled planes: depth_*.png and planes_*.png with "
                 "*.K, or *.depth(.gz) with planes_*.png, also in its folders")
      ->required();
  app.add_option("--min-iou", command.min_iou, "from which a segment is a labelled plane's")
      ->check(CLI::Range(0.51, 1.0))
      ->capture_default_str();
  app.add_option("--min-px", command.min_px,
                 "labelled planes of fewer pixels with depth do not count; a second row counts all")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  app.add_option("--settings", command.settings_file, "YAML file of the extractor's settings");
  app.add_option("--set", command.assignments, "key=value: a setting of the extractor");
  app.add_option("--pictures", command.pictures, "folder for the labels: truth above, found below");
  app.add_option("--json", command.json, "file for the figures");
}

int evaluate_planes_command(const PlanesCommand& command) {
  auto settings = command.settings_file.empty() ? Settings::empty("command line")
                                                : Settings::from_file(command.settings_file);
  for (const auto& assignment : command.assignments) settings.set(assignment);
  plane::ExtractorOptions options;
  settings.read(options);
  const plane::Extractor extractor(options);
  if (!command.pictures.empty()) std::filesystem::create_directories(command.pictures);
  std::printf("%-34s %5s %5s %5s   %5s %5s %5s %5s   %10s %6s   %10s %7s\n", "", "truth", "found",
              "right", "prec", "rec", "IoU", "area", "1 deg", "worst", "1 cm", "worst mm");
  std::map<std::string, Tally> by_folder;
  Tally counted, all;
  int without_truth = 0;
  for (const auto& file : dataset::list_plane_scans(command.dataset)) {
    const auto scan = dataset::read_plane_scan(file);
    if (scan.truth.empty()) {
      ++without_truth;
      continue;
    }
    const auto found = extractor.extract(scan.frame);
    const cv::Mat has_depth = scan.frame.depth != 0;
    // Cylinders are no planes.
    cv::Mat labels = found.labels.clone();
    labels.setTo(0, labels > static_cast<int>(found.planes.size()));
    const auto large = evaluation::evaluate_segmentation(labels, scan.truth, has_depth,
                                                         command.min_iou, command.min_px);
    all.add(evaluation::evaluate_segmentation(labels, scan.truth, has_depth, command.min_iou, 1));
    Tally one;
    one.add(large);
    for (const auto& match : large.matches) {
      if (match.iou < command.min_iou) continue;
      const auto truth = evaluation::fit_plane(scan.frame, scan.truth == match.truth);
      const auto& plane = found.planes[static_cast<std::size_t>(match.segment) - 1].plane;
      one.angles_deg.push_back(degrees_between(truth.normal, plane.normal));
      one.distances_m.push_back(std::abs(truth.distance_m - plane.distance_m));
    }
    print(scan.name, one);
    for (Tally* tally : {&counted, &by_folder[scan.name.substr(0, scan.name.find('/'))]}) {
      tally->add(large);
      tally->angles_deg.insert(tally->angles_deg.end(), one.angles_deg.begin(),
                               one.angles_deg.end());
      tally->distances_m.insert(tally->distances_m.end(), one.distances_m.begin(),
                                one.distances_m.end());
    }
    if (!command.pictures.empty()) {
      std::string name = scan.name;
      std::replace(name.begin(), name.end(), '/', '-');
      cv::imwrite(command.pictures + "/" + name + ".png", picture(scan.truth, labels));
    }
  }
  if (counted.scans == 0) throw Error(command.dataset + ": no depth image has labelled planes");
  nlohmann::json json = counted.json();
  print("all, " + std::to_string(command.min_px) + " px or more", counted);
  print("all", all);
  for (const auto& [folder, tally] : by_folder) json["folders"][folder] = tally.json();
  json["of_any_size"] = all.json();
  json["min_iou"] = command.min_iou;
  json["min_px"] = command.min_px;
  json["without_truth"] = without_truth;
  if (!command.json.empty()) write_text_file(command.json, json.dump(1) + "\n");
  return 0;
}

}  // namespace weft::evaluate
