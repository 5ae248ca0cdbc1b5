#pragma once

#include <opencv2/core/mat.hpp>

#include "base/options.hpp"
#include "base/simd.hpp"
#include "rgbd/surface.hpp"

namespace weft::rgbd {

struct NormalOptions {
  double radius_m = 0.010;
  double depth_gate_m = 0.007;
  double depth_noise_per_m = 0.003;
  double min_share = 0.25;
  int max_radius_px = 12;

  void visit(OptionVisitor& v) {
    v.field("radius_m", radius_m, {0.001, 0.2}, "m",
            "radius of the window the plane is fitted to; at least 2 px. 10 mm is 5 px at 1 m: "
            "normals of a flat table scatter by 7 degrees, wrinkles of 30 mm keep their shape");
    v.field("depth_gate_m", depth_gate_m, {0.0, 1.0}, "m",
            "a point further in front of or behind the window's centre belongs to another surface");
    v.field("depth_noise_per_m", depth_noise_per_m, {0.0, 0.1}, "1/m",
            "widens the gate by this times the squared distance: a step of a Kinect's disparity");
    v.field("min_share", min_share, {0.0, 1.0}, "",
            "no normal where fewer of the window's points are there and inside the gate");
    v.field("max_radius_px", max_radius_px, {2, 15}, "px",
            "bounds the cost of surfaces near the camera");
  }
  void validate() const { validate_fields(*this, "NormalOptions"); }
};

/// Normals of a surface, CV_32FC3, of unit length and facing the camera (n . p < 0); NaN where the
/// point is missing or no plane can be fitted.
///
/// Least squares of inverse depth = a u + b v + c, to which every plane projects exactly and in
/// which the noise of a Kinect is the same at every distance, over the points of the pixel's window
/// that lie within the gate of its depth. So what lies beyond a depth jump does not count, and of a
/// hole only its missing points. There is no normal where the points lie on a line or nearly so.
///
/// where: CV_8UC1 of the surface's size, normals are needed where it is not 0 (groups of eight
/// pixels are computed as a whole); empty: everywhere. Class A: the same bits on every machine,
/// SIMD path and thread count. threads < 1: one for each core. Throws Error when points, camera
/// and `where` do not have one size.
cv::Mat estimate_normals(const Surface& surface, const NormalOptions& options, int threads,
                         const cv::Mat& where = {}, SimdPath path = SimdPath::kAuto);

}  // namespace weft::rgbd
