#pragma once

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "slam/rigid3d.hpp"
#include "support/plane_scene.hpp"

/// A room whose walls carry random patches, seen from a moving camera: pictures to track in.
namespace weft::test {

/// Grey value of a wall at a place: squares of 4 and 13 cm of random brightness. No two places of a
/// room look alike.
inline int patch_grey(int wall, double x_m, double y_m) {
  const auto value = [&](double size_m, std::uint64_t salt) {
    const auto i = static_cast<std::int64_t>(std::floor(x_m / size_m));
    const auto j = static_cast<std::int64_t>(std::floor(y_m / size_m));
    Random random(static_cast<std::uint64_t>(i * 7919 + j * 104729 + wall * 1299709) ^ salt);
    return random.uniform();
  };
  return static_cast<int>(40.0 + 110.0 * value(0.04, 17) + 90.0 * value(0.13, 99));
}

struct TexturedRoom {
  rgbd::CameraModel camera{640, 480, 525.0, 525.0, 319.5, 239.5};
  double depth_unit_m = 0.0002;
  /// World frame: x right, y down, z ahead; the camera starts at its origin.
  std::vector<Wall> walls = {{{0, -1, 0}, -1.2}, {{0, 0, -1}, -2.8}, {{1, 0, 0}, -1.6},
                             {{-1, 0, 0}, -1.9}, {{0, 0, 1}, -1.5},  {{0, 1, 0}, -1.4}};

  rgbd::RgbdFrame render(const slam::Rigid3d& T_world_camera) const {
    rgbd::RgbdFrame frame;
    frame.camera = camera;
    frame.depth_unit_m = depth_unit_m;
    frame.source = "room";
    frame.colour.create(camera.height, camera.width, CV_8UC3);
    frame.depth = cv::Mat::zeros(camera.height, camera.width, CV_16UC1);
    for (int v = 0; v < camera.height; ++v)
      for (int u = 0; u < camera.width; ++u) {
        // z of the ray is 1, so the distance along it is the depth.
        const Eigen::Vector3d ray = T_world_camera.rotation * camera.unproject(u, v, 1.0);
        double z_m = 1e9;
        int hit = -1;
        for (std::size_t i = 0; i < walls.size(); ++i) {
          const double towards = walls[i].normal.dot(ray);
          if (towards >= 0.0) continue;
          const double z =
              (walls[i].distance_m - walls[i].normal.dot(T_world_camera.translation)) / towards;
          if (z > 0.0 && z < z_m) {
            z_m = z;
            hit = static_cast<int>(i);
          }
        }
        auto& px = frame.colour.at<cv::Vec3b>(v, u);
        px = {0, 0, 0};
        if (hit < 0) continue;
        const Eigen::Vector3d at = T_world_camera.translation + ray * z_m;
        const Eigen::Vector3d n = walls[static_cast<std::size_t>(hit)].normal.cwiseAbs();
        const double a = n.x() > 0.5 ? at.y() : at.x(), b = n.z() > 0.5 ? at.y() : at.z();
        const auto grey = static_cast<uchar>(patch_grey(hit, a, b));
        px = {grey, grey, grey};
        frame.depth.at<std::uint16_t>(v, u) =
            static_cast<std::uint16_t>(std::lround(z_m / depth_unit_m));
      }
    return frame;
  }

  /// A slow sway through the room, 30 frames a second; frame 0 at the origin.
  static slam::Rigid3d path(double t_s) {
    slam::Rigid3d T_world_camera;
    T_world_camera.translation = {0.5 * std::sin(0.8 * t_s), 0.08 * std::sin(1.9 * t_s),
                                  0.25 * (1.0 - std::cos(0.9 * t_s))};
    T_world_camera.rotation =
        Eigen::AngleAxisd(0.35 * std::sin(0.7 * t_s), Eigen::Vector3d::UnitY()) *
        Eigen::AngleAxisd(0.12 * std::sin(1.3 * t_s), Eigen::Vector3d::UnitX());
    return T_world_camera;
  }
};

}  // namespace weft::test
