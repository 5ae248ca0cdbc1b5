#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "base/options.hpp"
#include "rgbd/frame.hpp"

/// The table under the garments. Everything here is class A: the same bits everywhere.
namespace weft::foreground {

struct TableOptions {
  int hypotheses = 600;
  double inlier_m = 0.010;
  double behind_m = 0.015;
  double max_behind_share = 0.01;
  double other_surface_m = 0.3;
  double min_share = 0.10;
  double max_tilt_deg = 70.0;
  int seed = 1;

  void visit(OptionVisitor& v) {
    v.field("hypotheses", hypotheses, {10, 100000}, "",
            "planes tried; three points on the table make one, so 600 miss a table that takes a "
            "fifth of "
            "the points in 1 frame of 100, one that takes a tenth in every other frame");
    v.field("inlier_m", inlier_m, {0.001, 0.2}, "m",
            "a point this near belongs to the plane, at 1 m or less; grows with the squared "
            "distance as the noise of structured light does");
    v.field("behind_m", behind_m, {0.001, 0.5}, "m",
            "a point this far behind a plane counts against it; grows likewise");
    v.field("max_behind_share", max_behind_share, {0.0, 1.0}, "",
            "of all points, behind the table at most; a large flat garment has the table behind "
            "it, the table hardly anything");
    v.field("other_surface_m", other_surface_m, {0.05, 10.0}, "m",
            "points this far behind a plane do not count against it: the floor beside the table; "
            "and a plane this far before another one is the table");
    v.field("min_share", min_share, {0.01, 1.0}, "", "of all points, on the table at least");
    v.field("max_tilt_deg", max_tilt_deg, {0.0, 85.0}, "deg",
            "between the table's normal and the optical axis at most");
    v.field("seed", seed, {0, 1 << 30}, "", "of the random planes");
  }
  void validate() const { validate_fields(*this, "TableOptions"); }
};

/// The table as the sensor sees it: its plane bent by the sensor's own low-order distortion.
/// Inverse depth is a quadratic polynomial of the pixel (a plane's is linear).
class TableSurface {
 public:
  TableSurface(const rgbd::CameraModel& camera, const rgbd::Plane& plane);

  /// Height in metres above the surface, along the plane's normal, positive towards the camera, of
  /// the point seen at a pixel at depth z.
  double height_m(double u_px, double v_px, double z_m) const {
    const double x = (u_px - camera_.cx) / camera_.fx, y = (v_px - camera_.cy) / camera_.fy;
    const double inverse_z = at(x, y);
    return (plane_.normal.x() * x + plane_.normal.y() * y + plane_.normal.z()) *
           (z_m - 1.0 / inverse_z);
  }
  const rgbd::Plane& plane() const { return plane_; }

 private:
  friend TableSurface fit_surface(const rgbd::RgbdFrame&, const cv::Mat&, const rgbd::Plane&, int);
  double at(double x, double y) const {
    return c_[0] + c_[1] * x + c_[2] * y + x * x * (c_[3] + c_[6] * x + c_[7] * y) + x * y * c_[4] +
           y * y * (c_[5] + c_[8] * x + c_[9] * y);
  }
  rgbd::CameraModel camera_;
  rgbd::Plane plane_;
  std::array<double, 10> c_{};  // of 1, x, y, xx, xy, yy, xxx, xxy, xyy, yyy; in focal lengths
};

/// The large plane that hardly anything lies closely behind, preferring support at the border of
/// the valid depth, and what stands before it by other_surface_m: the table, not the cloth on it
/// nor the floor beside it. None when no plane meets the options. exclude: CV_8UC1 of the frame's
/// size, pixels that are not 0 are not looked at; may be empty.
std::optional<rgbd::Plane> find_table(const rgbd::RgbdFrame& frame, const cv::Mat& exclude,
                                      const TableOptions& options);

/// The plane fitted again to the points near it, and to none of those excluded; unchanged when
/// fewer than 50 are left.
rgbd::Plane refine_plane(const rgbd::RgbdFrame& frame, const cv::Mat& exclude,
                         const rgbd::Plane& plane);

/// Fits the sensor's distortion of the table robustly with a polynomial of degree 2 or 3. exclude
/// as for find_table; when it is empty cloth is to be expected, and points above the surface lose
/// their weight sooner than points below.
TableSurface fit_surface(const rgbd::RgbdFrame& frame, const cv::Mat& exclude,
                         const rgbd::Plane& plane, int degree);

}  // namespace weft::foreground
