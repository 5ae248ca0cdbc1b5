#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "base/random.hpp"
#include "rgbd/surface.hpp"

/// Surfaces given by formulas, with their true normals, as a Kinect sees them.
namespace weft::test {

/// A height field over the table; the nearest of the layers is seen.
struct Layer {
  std::function<double(double x_m, double y_m)> height_m = [](double, double) { return 0.0; };
  std::function<bool(double x_m, double y_m)> inside = [](double, double) { return true; };
};

struct AnalyticScene {
  std::vector<Layer> layers = {{}};
  rgbd::CameraModel camera{640, 480, 525.0, 525.0, 319.5, 239.5};
  double distance_m = 1.0;
  double tilt_deg = 10.0;
  /// Standard deviation of the disparity at 0.075 m baseline, the same over about 3 px (the table
  /// in the towel scans: normals of 5 px radius scatter by 7 degrees); its step; how far a pixel's
  /// ray strays. All 0: the surface itself.
  double noise_px = 0.08;
  double step_px = 0.125;
  double stray_px = 0.4;
  int holes = 250;        // up to 14 px wide
  int missing_px = 3000;  // single pixels
  std::uint64_t seed = 1;
};

struct AnalyticView {
  rgbd::Surface surface;
  cv::Mat normals;  // CV_32FC3, the true ones
  cv::Mat layer;    // CV_8UC1
};

struct LayerHit {
  double z_m = std::numeric_limits<double>::infinity();
  int layer = 255;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
};

inline LayerHit hit(const AnalyticScene& scene, double u, double v) {
  const Eigen::Matrix3d table =
      Eigen::AngleAxisd(scene.tilt_deg * M_PI / 180.0, Eigen::Vector3d::UnitX()).matrix();
  const Eigen::Vector3d right = table.col(0), down = table.col(1), up = -table.col(2);
  const Eigen::Vector3d foot(0, 0, scene.distance_m);
  const Eigen::Vector3d ray = scene.camera.unproject(u, v, 1.0);
  LayerHit nearest;
  for (std::size_t i = 0; i < scene.layers.size(); ++i) {
    const Layer& layer = scene.layers[i];
    double z = up.dot(foot) / up.dot(ray), x = 0.0, y = 0.0;
    for (int step = 0; step < 12; ++step) {
      const Eigen::Vector3d point = ray * z - foot;
      x = right.dot(point);
      y = down.dot(point);
      z = (up.dot(foot) + layer.height_m(x, y)) / up.dot(ray);
    }
    if (!layer.inside(x, y) || !(z > 0.0) || z >= nearest.z_m) continue;
    const double e = 1e-5;
    const double along_x = (layer.height_m(x + e, y) - layer.height_m(x - e, y)) / (2 * e);
    const double along_y = (layer.height_m(x, y + e) - layer.height_m(x, y - e)) / (2 * e);
    nearest.z_m = z;
    nearest.layer = static_cast<int>(i);
    nearest.normal = (up - along_x * right - along_y * down).normalized();
  }
  return nearest;
}

inline AnalyticView render(const AnalyticScene& scene) {
  const int width = scene.camera.width, height = scene.camera.height;
  const double disparity_m = scene.camera.fx * 0.075;
  Random random(scene.seed);
  // The mean of nine is a third as large.
  cv::Mat noise(height + 2, width + 2, CV_64FC1);
  for (int v = 0; v < noise.rows; ++v)
    for (int u = 0; u < noise.cols; ++u)
      noise.at<double>(v, u) = scene.noise_px > 0.0 ? scene.noise_px / 3.0 * random.normal() : 0.0;
  AnalyticView view;
  view.surface.camera = scene.camera;
  view.surface.points_m.create(height, width, CV_32FC3);
  view.normals.create(height, width, CV_32FC3);
  view.layer.create(height, width, CV_8UC1);
  const auto missing = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      const LayerHit truth = hit(scene, u, v);
      LayerHit seen = truth;
      if (scene.stray_px > 0.0)
        seen =
            hit(scene, u + scene.stray_px * random.normal(), v + scene.stray_px * random.normal());
      view.layer.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(truth.layer);
      view.normals.at<cv::Vec3f>(v, u) =
          cv::Vec3f(static_cast<float>(truth.normal.x()), static_cast<float>(truth.normal.y()),
                    static_cast<float>(truth.normal.z()));
      auto& point = view.surface.points_m.at<cv::Vec3f>(v, u);
      point = missing;
      if (!std::isfinite(seen.z_m)) continue;
      double disparity = disparity_m / seen.z_m;
      for (int dv = 0; dv < 3; ++dv)
        for (int du = 0; du < 3; ++du) disparity += noise.at<double>(v + dv, u + du);
      if (scene.step_px > 0.0) disparity = std::round(disparity / scene.step_px) * scene.step_px;
      const Eigen::Vector3d p = scene.camera.unproject(u, v, disparity_m / disparity);
      point = {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())};
    }
  const auto below = [&](int n) {
    return static_cast<int>(random.below(static_cast<std::uint64_t>(n)));
  };
  for (int i = 0; i < scene.holes; ++i) {
    const cv::Rect hole(below(width), below(height), 1 + below(14), 1 + below(14));
    view.surface.points_m(hole & cv::Rect(0, 0, width, height)) = cv::Scalar::all(missing[0]);
  }
  for (int i = 0; i < scene.missing_px; ++i)
    view.surface.points_m.at<cv::Vec3f>(below(height), below(width)) = missing;
  return view;
}

}  // namespace weft::test
