#pragma once

#include <opencv2/core/mat.hpp>

#include "rgbd/frame.hpp"
#include "rgbd/view.hpp"

namespace weft::rgbd {

/// What a view shows of the scene's surface: one point a view pixel, for the descriptors of depth.
///
/// Sensor view: the back-projected depth image in the camera frame. Rectified view: the view frame
/// has its origin at the camera's centre, x and y along the view's, z along minus the table's
/// normal. In both, x is right, y down, z away from the camera, in metres.
struct Surface {
  cv::Mat points_m;    // CV_32FC3, view.height x view.width; NaN in all three = missing
  CameraModel camera;  // the view's own pinhole: it projects each point to its pixel
};

/// Depths that differ by more than this share of the distance belong to two surfaces. Neighbouring
/// pixels at 1 m are 1.9 mm apart, so cloth as steep as 80 degrees is still one.
inline constexpr double kDepthJump = 0.015;

/// Rectified: the depth of the four sensor pixels around is interpolated bilinearly, so that a view
/// finer than the sensor repeats no point; the point is missing where one of them is, or where
/// they straddle a depth jump. Class A: the same bits everywhere. Throws Error when the frame is
/// not that of the view's sensor.
Surface render_surface(const RgbdFrame& frame, const View& view);

}  // namespace weft::rgbd
