#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

/// Cylinders through oriented points.
namespace weft::plane {

struct OrientedPoint {
  Eigen::Vector3d point;   // m
  Eigen::Vector3d normal;  // unit length, towards the camera
  double gate_m;           // up to this far from the surface it belongs to it
};

struct Cylinder {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  // on the axis, m
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // unit length
  double radius_m = 0.0;
  bool convex = true;  // normals point away from the axis

  /// Distance outside the surface, m.
  double height_m(const Eigen::Vector3d& x) const;
};

struct CylinderFit {
  Cylinder cylinder;
  std::vector<int> inliers;  // indices, ascending
  double rms_m = 0.0;        // of the inliers' distances
};

/// Moves a cylinder to the least squares of the points' distances from it, by a few Gauss-Newton
/// steps; returns the root mean square distance.
double refine_cylinder(const std::vector<Eigen::Vector3d>& points, Cylinder& cylinder);

/// The cylinder with the most inliers: points within their gate whose normals agree within
/// max_angle_deg (CAPE, section III.C, with two oriented points a hypothesis).
/// Deterministic: hypotheses are drawn by a generator seeded with `seed`. None when fewer than
/// min_inliers agree, the radius exceeds max_radius_m, or the normals turn by less than
/// min_arc_deg.
std::optional<CylinderFit> fit_cylinder(const std::vector<OrientedPoint>& points, int min_inliers,
                                        double max_radius_m, double max_angle_deg,
                                        double min_arc_deg, std::uint64_t seed);

}  // namespace weft::plane
