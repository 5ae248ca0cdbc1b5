#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

#include "rgbd/pcd_io.hpp"
#include "support/analytic_scene.hpp"
#include "support/files.hpp"

/// Surfaces for tests of FPFH.
namespace weft::test {

inline constexpr const char* kTowelScan = "uc3m-garments/pcd/20150902_towel02_2_fold.pcd";
inline constexpr const char* kOfficeScan = "pcl-scans/office1.pcd";

/// Cloth with wrinkles and a fold that lies 3 cm above it, holes and noise.
inline AnalyticScene folded_cloth(int width, int height) {
  AnalyticScene scene;
  scene.camera = {width, height, 525.0, 525.0, 0.5 * width, 0.5 * height - 1.0};
  scene.layers[0].height_m = [](double x, double y) {
    return 0.006 * std::sin(150 * x + 60 * y) * std::sin(90 * y);
  };
  scene.layers.push_back({[](double x, double) { return 0.03 + 0.1 * x; },
                          [](double x, double y) { return x > 0.02 && y < 0.5 * x; }});
  scene.holes = width * height / 1500;
  scene.missing_px = width * height / 100;
  return scene;
}

/// A part of a scan, as its camera sees it.
inline rgbd::Surface scan_part(const std::filesystem::path& path, cv::Rect part) {
  const auto cloud = rgbd::read_pcd(path);
  rgbd::Surface surface;
  surface.camera = rgbd::fit_camera(cloud, path).camera;
  surface.camera.cx -= part.x;
  surface.camera.cy -= part.y;
  surface.camera.width = part.width;
  surface.camera.height = part.height;
  surface.points_m.create(part.size(), CV_32FC3);
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      const auto& p =
          cloud.points[static_cast<std::size_t>((part.y + y) * cloud.width + part.x + x)];
      surface.points_m.at<cv::Vec3f>(y, x) = {p.x(), p.y(), p.z()};
    }
  }
  return surface;
}

}  // namespace weft::test
