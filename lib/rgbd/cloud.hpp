#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "rgbd/frame.hpp"

/// Point clouds as scanners save them, and their relation to depth images.
namespace weft::rgbd {

/// Points in the camera frame, row by row. Organised (one point for each pixel) when height > 1.
struct Cloud {
  int width = 0;
  int height = 0;
  std::vector<Eigen::Vector3f> points;  // metres; NaN in all three = missing
  cv::Mat colour;                       // CV_8UC3, BGR, height x width; empty when there is none

  bool organised() const { return height > 1; }
};

struct CameraFit {
  CameraModel camera;
  double max_error_px = 0.0;  // largest distance of a projected point from its pixel
  int points = 0;             // valid points used
};

/// The pinhole an organised cloud was made with: least squares of u = fx x/z + cx and
/// v = fy y/z + cy over its valid points. Throws Error starting with `where` when the cloud is not
/// organised, has too few valid points or too little spread of them, lies behind the camera or is
/// mirrored.
CameraFit fit_camera(const Cloud& cloud, const std::string& where);

/// Depth image of an organised cloud seen by `camera`: z rounded to counts of unit_m. Throws Error
/// starting with `where` when a point does not project within half a pixel of its place, or when a
/// depth exceeds 65535 counts.
RgbdFrame frame_from_cloud(const Cloud& cloud, const CameraModel& camera, double unit_m,
                           const std::string& where);

/// The organised cloud of a frame's depth image, with its colour.
Cloud cloud_from_frame(const RgbdFrame& frame);

}  // namespace weft::rgbd
