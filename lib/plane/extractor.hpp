#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <utility>
#include <vector>

#include "base/options.hpp"
#include "rgbd/frame.hpp"

/// Planes and cylinders of a depth image.
namespace weft::plane {

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
  /// tangent_basis(normal): n = normal + t0 e0 + t1 e1. No floors for systematic errors of the
  /// sensor are applied here.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  int cells = 0;
  /// Centroids of its cells, moved onto the plane along its normal; row by row.
  std::vector<Eigen::Vector3f> points_camera;
};

struct CylinderSegment {
  Eigen::Vector3d point_camera = Eigen::Vector3d::Zero();  // on the axis, middle of what is seen, m
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // unit length; its largest component positive
  double radius_m = 0.0;
  double rms_m = 0.0;  // root mean square distance of its cells' centroids to the surface
  int support = 0;     // pixels labelled with it
  int cells = 0;
  std::vector<Eigen::Vector3f> points_camera;  // centroids of its cells, row by row
};

struct Extraction {
  std::vector<PlaneSegment> planes;        // the largest (most labelled pixels) first
  std::vector<CylinderSegment> cylinders;  // likewise
  cv::Mat labels;  // CV_8UC1 of the frame's size: 0 = none, 1 ... planes, then cylinders
};

}  // namespace weft::plane
