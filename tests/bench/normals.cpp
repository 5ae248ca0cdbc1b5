// Accuracy and time of normals of organised scans, ours beside PCL's, on surfaces whose normals are
// known: everywhere, near holes and near edges.
#include <pcl/features/integral_image_normal.h>
#include <pcl/features/normal_3d_omp.h>
#include <pcl/search/organized.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "bench/timing.hpp"
#include "rgbd/normals.hpp"
#include "support/analytic_scene.hpp"

namespace {

using namespace weft;  // NOLINT: a program

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;

Cloud::Ptr cloud_of(const cv::Mat& points_m) {
  auto cloud = Cloud::Ptr(new Cloud(static_cast<std::uint32_t>(points_m.cols),
                                    static_cast<std::uint32_t>(points_m.rows)));
  cloud->is_dense = false;
  for (int v = 0; v < points_m.rows; ++v)
    for (int u = 0; u < points_m.cols; ++u) {
      const auto& p = points_m.at<cv::Vec3f>(v, u);
      cloud->at(u, v) = pcl::PointXYZ(p[0], p[1], p[2]);
    }
  return cloud;
}

cv::Mat mat_of(const Normals& normals, cv::Size size) {
  cv::Mat out(size, CV_32FC3);
  for (int i = 0; i < size.area(); ++i) {
    const auto& n = normals[static_cast<std::size_t>(i)];
    out.ptr<cv::Vec3f>()[i] = {n.normal_x, n.normal_y, n.normal_z};
  }
  return out;
}

struct Errors {
  std::vector<double> degrees;
  int pixels = 0;
};
enum Region { kPlain, kNearHole, kNearEdge, kRegions };
constexpr const char* kRegionNames[] = {"plain", "near_hole", "near_edge"};
constexpr int kNear = 5;  // px

bool missing(const cv::Vec3f& p) { return !(p[2] == p[2]); }

std::vector<Errors> errors_of(const test::AnalyticView& view, const cv::Mat& normals) {
  std::vector<Errors> errors(kRegions);
  const cv::Mat& points = view.surface.points_m;
  const int margin = 12;  // PCL has no normals at the image's border
  for (int v = margin; v < points.rows - margin; ++v)
    for (int u = margin; u < points.cols - margin; ++u) {
      if (missing(points.at<cv::Vec3f>(v, u))) continue;
      Region region = kPlain;
      const int layer = view.layer.at<std::uint8_t>(v, u);
      for (int y = v - kNear; y <= v + kNear; ++y)
        for (int x = u - kNear; x <= u + kNear; ++x) {
          if (view.layer.at<std::uint8_t>(y, x) != layer) region = kNearEdge;
          if (region == kPlain && missing(points.at<cv::Vec3f>(y, x))) region = kNearHole;
        }
      ++errors[region].pixels;
      const auto& n = normals.at<cv::Vec3f>(v, u);
      if (missing(n)) continue;
      const double cosine = std::clamp<double>(n.dot(view.normals.at<cv::Vec3f>(v, u)), -1.0, 1.0);
      errors[region].degrees.push_back(std::acos(cosine) * 180.0 / M_PI);
    }
  return errors;
}

}  // namespace

int main(int argc, char** argv) {
  bench::keep_memory();
  CLI::App app{"Normals of organised scans, ours beside PCL's, on surfaces with known normals"};
  rgbd::NormalOptions options;
  double noise_px = 0.08;
  int runs = 3;
  std::string json;
  app.add_option("--radius", options.radius_m, "m")->capture_default_str();
  app.add_option("--gate", options.depth_gate_m, "m")->capture_default_str();
  app.add_option("--noise", noise_px, "of the disparity, px")->capture_default_str();
  app.add_option("--runs", runs, "the fastest counts")->check(CLI::Range(1, 1000));
  app.add_option("--json", json, "write the results here");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  const auto waves = [](double height_m, double length_m) {
    return [=](double x, double y) {
      return height_m * std::sin(2 * M_PI * (0.8 * x + 0.6 * y) / length_m);
    };
  };
  // Squares of 5 cm, every other one raised.
  const auto chequers = [](double height_m) {
    test::Layer raised;
    raised.height_m = [=](double, double) { return height_m; };
    raised.inside = [](double x, double y) {
      return ((static_cast<int>(std::floor(x / 0.05)) + static_cast<int>(std::floor(y / 0.05))) &
              1) != 0;
    };
    return std::vector<test::Layer>{{}, raised};
  };
  std::vector<std::pair<std::string, test::AnalyticScene>> scenes(9);
  scenes[0].first = "plane, 10 deg";
  scenes[1].first = "plane, 45 deg";
  scenes[1].second.tilt_deg = 45;
  scenes[2].first = "plane, 65 deg";
  scenes[2].second.tilt_deg = 65;
  scenes[3].first = "waves of 50 mm";
  scenes[3].second.layers[0].height_m = waves(0.006, 0.05);
  scenes[4].first = "waves of 30 mm";
  scenes[4].second.layers[0].height_m = waves(0.004, 0.03);
  scenes[5].first = "creases of 90 deg";
  scenes[5].second.layers[0].height_m = [](double x, double) {
    const double t = x / 0.06 - std::floor(x / 0.06);
    return 0.06 * std::abs(t - 0.5);
  };
  scenes[6] = {"steps of 5 mm", {.layers = chequers(0.005)}};
  scenes[7] = {"steps of 10 mm", {.layers = chequers(0.010)}};
  scenes[8] = {"steps of 30 mm", {.layers = chequers(0.030)}};

  nlohmann::json report;
  std::printf(
      "%-18s %-34s %8s  %s\n", "", "", "ms",
      "median / mean / 95 % error in degrees, pixels with a normal:  plain | within 5 px of "
      "a hole | of an edge");
  for (auto& [name, scene] : scenes) {
    scene.noise_px = noise_px;
    const auto view = test::render(scene);
    const auto cloud = cloud_of(view.surface.points_m);
    const auto size = view.surface.points_m.size();
    const auto row = [&](const char* method, const std::function<cv::Mat()>& compute) {
      cv::Mat normals;
      const double ms = bench::best_ms(runs, 1, [&] { normals = compute(); });
      auto errors = errors_of(view, normals);
      std::printf("%-18s %-34s %8.1f", name.c_str(), method, ms);
      nlohmann::json& result = report[name][method];
      result["ms"] = ms;
      for (int region = 0; region < kRegions; ++region) {
        auto& degrees = errors[static_cast<std::size_t>(region)].degrees;
        if (degrees.empty()) continue;
        std::sort(degrees.begin(), degrees.end());
        double sum = 0.0;
        for (const double d : degrees) sum += d;
        const auto n = degrees.size();
        const double mean = sum / double(n),
                     share = double(n) / errors[static_cast<std::size_t>(region)].pixels;
        result[kRegionNames[region]] = {{"p50_deg", degrees[n / 2]},
                                        {"mean_deg", mean},
                                        {"p95_deg", degrees[n * 95 / 100]},
                                        {"share", share}};
        std::printf("  | %5.1f %5.1f %5.1f %3.0f%%", degrees[n / 2], mean, degrees[n * 95 / 100],
                    100 * share);
      }
      std::printf("\n");
    };
    using Integral = pcl::IntegralImageNormalEstimation<pcl::PointXYZ, pcl::Normal>;
    const auto integral = [&](Integral::NormalEstimationMethod method) {
      Integral estimation;
      estimation.setNormalEstimationMethod(method);
      estimation.setMaxDepthChangeFactor(0.02f);
      estimation.setNormalSmoothingSize(
          static_cast<float>(2.0 * options.radius_m * scene.camera.fx / scene.distance_m + 1.0));
      estimation.setInputCloud(cloud);
      Normals normals;
      estimation.compute(normals);
      return mat_of(normals, size);
    };
    row("ours", [&] { return rgbd::estimate_normals(view.surface, options, 1); });
    row("PCL integral image, covariance", [&] { return integral(Integral::COVARIANCE_MATRIX); });
    row("PCL integral image, 3D gradient", [&] { return integral(Integral::AVERAGE_3D_GRADIENT); });
    row("PCL integral image, depth change",
        [&] { return integral(Integral::AVERAGE_DEPTH_CHANGE); });
    row("PCL NormalEstimationOMP", [&] {
      pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::Normal> estimation(1);
      estimation.setSearchMethod(pcl::search::OrganizedNeighbor<pcl::PointXYZ>::Ptr(
          new pcl::search::OrganizedNeighbor<pcl::PointXYZ>));
      estimation.setRadiusSearch(options.radius_m);
      estimation.setInputCloud(cloud);
      Normals normals;
      estimation.compute(normals);
      return mat_of(normals, size);
    });
  }
  if (!json.empty()) {
    std::ofstream file(json);
    file << report.dump(2) << "\n";
    if (!file.flush()) {
      std::fprintf(stderr, "%s: cannot write\n", json.c_str());
      return 1;
    }
  }
  return 0;
}
