#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "base/random.hpp"
#include "rgbd/frame.hpp"

/// Scenes of planes and cylinders by formula, as a depth camera sees them.
namespace weft::test {

struct Wall {
  Eigen::Vector3d normal;  // towards the camera
  double distance_m;       // normal . x = distance_m
  std::function<bool(const Eigen::Vector3d&)> inside = [](const Eigen::Vector3d&) { return true; };
};

struct Tube {
  Eigen::Vector3d point, axis;
  double radius_m;
  double half_length_m = 100.0;
  bool hollow = false;  // its far, inner side is seen
};

struct PlaneScene {
  rgbd::CameraModel camera{640, 480, 525.0, 525.0, 319.5, 239.5};
  std::vector<Wall> walls;
  std::vector<Tube> tubes;
  double noise_per_m = 0.0;   // standard deviation of inverse depth of each pixel
  double common_per_m = 0.0;  // the same, of all pixels of a square of block_px
  int block_px = 20;
  double holes_share = 0.0;  // of the pixels
  double depth_unit_m = 0.0002;
  std::uint64_t seed = 1;
};

struct PlaneView {
  rgbd::RgbdFrame frame;
  cv::Mat truth;  // CV_8UC1: 0 = nothing, 1 ... the walls, then the tubes
};

inline double hit_m(const Wall& wall, const Eigen::Vector3d& ray) {
  const double z_m = wall.distance_m / wall.normal.dot(ray);
  return z_m > 0.0 && wall.inside(ray * z_m) ? z_m : std::numeric_limits<double>::infinity();
}

inline double hit_m(const Tube& tube, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d axis = tube.axis.normalized();
  const Eigen::Vector3d d = ray - axis * axis.dot(ray);
  const Eigen::Vector3d o = -(tube.point - axis * axis.dot(tube.point));
  const double a = d.squaredNorm(), b = o.dot(d),
               c = o.squaredNorm() - tube.radius_m * tube.radius_m;
  const double root = b * b - a * c;
  if (root < 0.0) return std::numeric_limits<double>::infinity();
  const double z_m = (-b + (tube.hollow ? 1.0 : -1.0) * std::sqrt(root)) / a;
  const bool inside = std::abs(axis.dot(ray * z_m - tube.point)) <= tube.half_length_m;
  return z_m > 0.0 && inside ? z_m : std::numeric_limits<double>::infinity();
}

inline PlaneView render(const PlaneScene& scene) {
  PlaneView view;
  const int width = scene.camera.width, height = scene.camera.height;
  view.frame.camera = scene.camera;
  view.frame.depth_unit_m = scene.depth_unit_m;
  view.frame.depth = cv::Mat::zeros(height, width, CV_16UC1);
  view.truth = cv::Mat::zeros(height, width, CV_8UC1);
  Random random(scene.seed);
  cv::Mat common((height + scene.block_px - 1) / scene.block_px,
                 (width + scene.block_px - 1) / scene.block_px, CV_64FC1);
  for (int i = 0; i < static_cast<int>(common.total()); ++i)
    common.ptr<double>()[i] = scene.common_per_m * random.normal();
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      const Eigen::Vector3d ray = scene.camera.unproject(u, v, 1.0);
      double nearest = std::numeric_limits<double>::infinity();
      int label = 0, next = 0;
      const auto take = [&](double z_m) {
        ++next;
        if (z_m < nearest) {
          nearest = z_m;
          label = next;
        }
      };
      for (const Wall& wall : scene.walls) take(hit_m(wall, ray));
      for (const Tube& tube : scene.tubes) take(hit_m(tube, ray));
      const double inverse = 1.0 / nearest + scene.noise_per_m * random.normal() +
                             common.at<double>(v / scene.block_px, u / scene.block_px);
      const bool hole = random.uniform() < scene.holes_share;
      const double counts = 1.0 / inverse / scene.depth_unit_m + 0.5;
      if (label == 0 || hole || !(counts >= 1.0 && counts < 65536.0)) continue;
      view.truth.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(label);
      view.frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(counts);
    }
  return view;
}

/// Corner of a room: floor, wall ahead, wall at the left, seen slightly from above.
inline PlaneScene room() {
  const Eigen::Matrix3d tilt =
      Eigen::AngleAxisd(0.35, Eigen::Vector3d(1.0, 0.2, 0.05).normalized()).matrix();
  PlaneScene scene;
  scene.walls = {{tilt * Eigen::Vector3d(0, -1, 0), -1.1},
                 {tilt * Eigen::Vector3d(0, 0, -1), -2.6},
                 {tilt * Eigen::Vector3d(1, 0, 0), -0.8}};
  return scene;
}

inline double overlap(const cv::Mat& a, const cv::Mat& b) {
  return cv::countNonZero(a & b) / std::max(1.0, static_cast<double>(cv::countNonZero(a | b)));
}

}  // namespace weft::test
