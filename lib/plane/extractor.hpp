#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "base/options.hpp"
#include "base/simd.hpp"
#include "rgbd/frame.hpp"

/// Planes and cylinders of a depth image. Class A: the same bits on every machine and SIMD path.
namespace weft::plane {

struct ExtractorOptions {
  int cell_px = 20;
  double min_depth_m = 0.2;
  double max_depth_m = 10.0;
  double min_valid_share = 0.5;
  double noise_per_m = 0.003;
  double margin_m = 0.006;
  double max_angle_deg = 15.0;
  int min_cells = 4;
  bool merge_apart = true;
  double border_sigmas = 3.0;
  bool cylinders = true;
  double max_radius_m = 0.5;
  double min_arc_deg = 50.0;

  void visit(OptionVisitor& v) {
    v.field("cell_px", cell_px, {8, 40}, "px",
            "side of the square cells planes are first fitted to");
    v.field("min_depth_m", min_depth_m, {0.05, 10.0}, "m", "nearer points are missing");
    v.field("max_depth_m", max_depth_m, {0.1, 1000.0}, "m", "farther points are missing");
    v.field("min_valid_share", min_valid_share, {0.1, 1.0}, "",
            "of a cell's pixels with depth at least");
    v.field(
        "noise_per_m", noise_per_m, {0.0, 0.1}, "1/m",
        "standard deviation of inverse depth at most; times z^2 that of depth. Each image's own "
        "is measured, from its flattest cells: 0.0015 for a Kinect (1.5 mm at 1 m)");
    v.field(
        "margin_m", margin_m, {0.0, 0.2}, "m",
        "root mean square distance from the plane, beside three times the noise, that a cell of a "
        "plane may have, and 0.3 of it from a plane of its own: bent sensors, uneven walls");
    v.field("max_angle_deg", max_angle_deg, {1.0, 60.0}, "deg",
            "between neighbouring cells, a cell and its plane, planes that are merged");
    v.field("min_cells", min_cells, {1, 10000}, "", "smaller segments are none");
    v.field("merge_apart", merge_apart,
            "merge coplanar segments that do not touch: a wall behind a pole, a floor on both "
            "sides of a table");
    v.field("border_sigmas", border_sigmas, {0.5, 10.0}, "",
            "pixels this many standard deviations of a segment's points from it belong to it");
    v.field("cylinders", cylinders, "look for cylinders where the surface is smooth but not flat");
    v.field("max_radius_m", max_radius_m, {0.01, 10.0}, "m", "of a cylinder");
    v.field("min_arc_deg", min_arc_deg, {5.0, 180.0}, "deg",
            "that the normals of a cylinder's cells cover at least");
  }
  /// Throws Error; min_depth_m must be below max_depth_m.
  void validate() const;
};

/// Unit vectors e0, e1 with e0 x e1 = normal, continuous in the normal except where its z changes
/// sign (Duff et al., Building an Orthonormal Basis, Revisited, JCGT 2017). The tilt (t0, t1) of a
/// normal n is the tangent vector t0 e0 + t1 e1, in radians.
inline std::pair<Eigen::Vector3d, Eigen::Vector3d> tangent_basis(const Eigen::Vector3d& normal) {
  const double sign = normal.z() < 0.0 ? -1.0 : 1.0;
  const double a = -1.0 / (sign + normal.z());
  const double b = normal.x() * normal.y() * a;
  return {{1.0 + sign * normal.x() * normal.x() * a, sign * b, -sign * normal.x()},
          {b, sign + normal.y() * normal.y() * a, -normal.y()}};
}

struct PlaneSegment {
  /// In the camera frame; support counts the pixels labelled with it, rms_m is of the points of its
  /// cells.
  rgbd::Plane plane;
  /// Of (tilt about e0 [rad], tilt about e1 [rad], distance [m]) with e0, e1 =
  /// tangent_basis(normal): n = normal + t0 e0 + t1 e1. From the scatter of its points in inverse
  /// depth, a cell counting as one measurement, as the noise of neighbouring pixels is not
  /// independent. No floors for systematic errors of the sensor are applied here.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  int cells = 0;
  /// Centroids of its cells, moved onto the plane along their rays; row by row.
  std::vector<Eigen::Vector3f> points_camera;
};

struct CylinderSegment {
  Eigen::Vector3d point_camera = Eigen::Vector3d::Zero();  // on the axis, middle of what is seen, m
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // unit length; its largest component positive
  double radius_m = 0.0;
  bool convex = true;  // seen from outside
  double rms_m = 0.0;  // root mean square distance of its cells' pixels from it
  int support = 0;     // pixels labelled with it
  int cells = 0;
  std::vector<Eigen::Vector3f> points_camera;  // centroids of its cells, row by row
};

struct Extraction {
  std::vector<PlaneSegment> planes;        // the largest (most labelled pixels) first
  std::vector<CylinderSegment> cylinders;  // likewise
  cv::Mat labels;  // CV_8UC1 of the frame's size: 0 = none, 1 ... planes, then cylinders
};

/// Extracts planes and cylinders after Proenca and Gao, Fast Cylinder and Plane Extraction from
/// Depth Cameras for Visual Odometry (CAPE), IROS 2018, with these differences: planes are fitted
/// to inverse depth, in which planes are linear and a Kinect's noise is the same everywhere; sums
/// are exact integers; normals are binned without a singularity at the optical axis; a region that
/// is not flat gives the plane around its seed and the rest back.
///
/// 1. A plane is fitted to each cell; cells with too few valid pixels or too large residuals are
///    left out.
/// 2. The flattest cell in the fullest bin of a histogram of normals is a seed; a plane grows from
///    it over neighbouring cells that agree in angle and distance with each other and with it. If
///    the surface goes on smoothly beyond the plane, a cylinder is tried, and taken when it
///    explains many more cells.
/// 3. Planes that one plane explains as well are merged.
/// 4. Each pixel in and around a segment's cells goes to the nearest segment within its noise, and
///    on into further cells as long as the segment has a good part of them.
///
/// At most 255 segments, the largest.
class Extractor {
 public:
  explicit Extractor(const ExtractorOptions& options, SimdPath path = SimdPath::kAuto);
  /// Throws Error when the depth image is not 16 bit, not of the camera's size or its unit is not
  /// positive. One thread; may be called from several at once.
  Extraction extract(const rgbd::RgbdFrame& frame) const;

 private:
  ExtractorOptions options_;
  SimdPath path_;
};

}  // namespace weft::plane
