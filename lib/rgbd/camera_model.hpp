#pragma once

#include <Eigen/Core>
#include <string>

namespace weft::rgbd {

/// Pinhole camera without distortion. Pixel (0, 0) is the centre of the top left pixel; the camera
/// frame has x right, y down, z forward, metres.
struct CameraModel {
  int width = 0;                                  // px
  int height = 0;                                 // px
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  // px

  Eigen::Vector2d project(const Eigen::Vector3d& point_camera) const {
    return {fx * point_camera.x() / point_camera.z() + cx,
            fy * point_camera.y() / point_camera.z() + cy};
  }
  Eigen::Vector3d unproject(double u_px, double v_px, double z_m) const {
    return {(u_px - cx) * z_m / fx, (v_px - cy) * z_m / fy, z_m};
  }
  Eigen::Matrix3d matrix() const;
  /// Throws Error naming `where` and the value: sizes 1 to 8192 px, finite values, positive focal
  /// lengths below 1e5 px, the principal point within three image sizes.
  void validate(const std::string& where) const;
  bool operator==(const CameraModel&) const = default;
};

}  // namespace weft::rgbd
