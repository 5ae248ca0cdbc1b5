#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "rgbd/frame.hpp"

/// Cloth on a table as a Kinect-like sensor sees it, with the truth known.
namespace weft::test {

struct TableScene {
  rgbd::CameraModel camera{640, 480, 525.0, 525.0, 319.5, 239.5};
  double distance_m = 1.05;
  double tilt_deg = 6.0;
  double noise_m = 0.002;
  double warp_m = 0.006;  // of the sensor, at the image's corners
  double step_px = 0.08;  // disparity steps, 0.075 m baseline
  std::uint64_t seed = 1;
  /// Height of the cloth above the table at table coordinates (x right, y down, metres from the
  /// foot of the optical axis); negative: no cloth.
  std::function<double(double x_m, double y_m)> cloth_m = [](double, double) { return -1.0; };
  /// Where the table's top ends; beyond it the floor is seen 0.7 m below.
  std::function<bool(double x_m, double y_m)> table_top = [](double, double) { return true; };
  /// BGR at table coordinates.
  std::function<cv::Vec3d(double x_m, double y_m, bool cloth)> colour;

  rgbd::Plane table() const {
    rgbd::Plane plane;
    plane.normal = Eigen::AngleAxisd(tilt_deg * M_PI / 180.0, Eigen::Vector3d::UnitX()) *
                   -Eigen::Vector3d::UnitZ();
    plane.distance_m = -distance_m * std::cos(tilt_deg * M_PI / 180.0);
    return plane;
  }

  /// The frame; frame.mask is the true mask.
  rgbd::RgbdFrame render() const {
    const rgbd::Plane plane = table();
    const Eigen::Vector3d foot(0, 0, distance_m);
    const Eigen::Vector3d right = Eigen::Vector3d::UnitX();
    const Eigen::Vector3d down = right.cross(plane.normal);
    rgbd::RgbdFrame frame;
    frame.camera = camera;
    frame.colour.create(camera.height, camera.width, CV_8UC3);
    frame.depth.create(camera.height, camera.width, CV_16UC1);
    frame.mask.create(camera.height, camera.width, CV_8UC1);
    Random random(seed);
    for (int v = 0; v < camera.height; ++v)
      for (int u = 0; u < camera.width; ++u) {
        const Eigen::Vector3d ray = camera.unproject(u, v, 1.0);
        // The ray meets the cloth's surface: a few fixed-point steps from the table up.
        double z = plane.distance_m / plane.normal.dot(ray), height = -1.0;
        Eigen::Vector2d at;
        for (int i = 0; i < 5; ++i) {
          const Eigen::Vector3d point = ray * z - foot;
          at = Eigen::Vector2d(right.dot(point), down.dot(point));
          height = cloth_m(at.x(), at.y());
          z = (plane.distance_m + std::max(0.0, height)) / plane.normal.dot(ray);
        }
        const bool cloth = height >= 0.0;
        const bool floor = !cloth && !table_top(at.x(), at.y());
        if (floor) z = (plane.distance_m - 0.7) / plane.normal.dot(ray);
        const double a = (u - camera.cx) / camera.width * 2,
                     b = (v - camera.cy) / camera.height * 2;
        double sensed = z + warp_m * (a * a + b * b - 0.6) / 1.4 + noise_m * random.normal();
        const double disparity = std::round(camera.fx * 0.075 / sensed / step_px) * step_px;
        sensed = camera.fx * 0.075 / disparity;
        frame.depth.at<std::uint16_t>(v, u) =
            static_cast<std::uint16_t>(std::lround(sensed * 1000));
        frame.mask.at<std::uint8_t>(v, u) = cloth ? 255 : 0;
        // Light falls off towards the corners.
        cv::Vec3d c = floor ? cv::Vec3d(60, 60, 70) : colour(at.x(), at.y(), cloth);
        c *= 1.0 - 0.15 * (a * a + b * b);
        for (int k = 0; k < 3; ++k)
          frame.colour.at<cv::Vec3b>(v, u)[k] = static_cast<std::uint8_t>(
              std::clamp(std::lround(c[k] + 2.5 * random.normal()), 0L, 255L));
      }
    return frame;
  }
};

/// Planks of light wood: streaks along x, joints, planks that differ.
inline cv::Vec3d planks(double x_m, double y_m) {
  const double plank = std::floor(y_m / 0.09);
  const double shade =
      12.0 * std::sin(17.0 * plank) + 8.0 * std::sin(900.0 * y_m + 3.0 * std::sin(9.0 * x_m));
  const bool joint = y_m / 0.09 - plank < 0.03;
  return cv::Vec3d(130, 160, 180) + cv::Vec3d::all(joint ? -50.0 : shade);
}

inline cv::Vec3d white(double, double) { return {200, 205, 205}; }

/// A T-shirt's outline with wrinkles of some millimetres.
inline double shirt_m(double x_m, double y_m, double thickness_m = 0.005) {
  const bool body = std::abs(x_m) < 0.17 && std::abs(y_m) < 0.24;
  const bool sleeve = std::abs(x_m) < 0.29 && y_m > -0.24 && y_m < -0.12;
  const bool neck = x_m * x_m + (y_m + 0.25) * (y_m + 0.25) < 0.07 * 0.07;
  if ((!body && !sleeve) || neck) return -1.0;
  const double wrinkle = std::sin(40.0 * x_m + 25.0 * y_m) * std::sin(13.0 * y_m);
  return thickness_m + 0.008 * wrinkle * wrinkle;
}

inline double iou(const cv::Mat& a, const cv::Mat& b) {
  return static_cast<double>(cv::countNonZero(a & b)) / std::max(1, cv::countNonZero(a | b));
}

}  // namespace weft::test
