#pragma once

#include <opencv2/core/mat.hpp>
#include <string>

#include "rgbd/camera_model.hpp"

namespace weft::rgbd {

/// A colour image with registered depth: both are seen by the same camera and have its size.
struct RgbdFrame {
  CameraModel camera;
  cv::Mat colour;  // CV_8UC3, BGR
  cv::Mat depth;   // CV_16UC1, counts of depth_unit_m along the optical axis; 0 = missing
  double depth_unit_m = 0.001;  // metres per count
  cv::Mat mask;        // CV_8UC1, 255 = garment: the data set's own mask; empty when there is none
  std::string source;  // name of the scene or device

  double depth_m(int u_px, int v_px) const {
    return depth.at<std::uint16_t>(v_px, u_px) * depth_unit_m;
  }
};

/// Plane in Hesse normal form: normal . x = distance_m, in the camera frame, the normal of unit
/// length pointing towards the camera (so distance_m is negative for a plane before the camera).
struct Plane {
  Eigen::Vector3d normal = -Eigen::Vector3d::UnitZ();
  double distance_m = 0.0;
  double rms_m = 0.0;  // root mean square distance of the supporting points
  int support = 0;     // number of supporting points

  /// Signed height above the plane, positive towards the camera.
  double height_m(const Eigen::Vector3d& point_camera) const {
    return normal.dot(point_camera) - distance_m;
  }
};

}  // namespace weft::rgbd
