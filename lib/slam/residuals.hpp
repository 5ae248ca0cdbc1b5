#pragma once

#include <Eigen/Core>
#include <string>

#include "slam/observations.hpp"

/// The residuals of all factors, divided by their standard deviations, and their derivatives by the
/// increments of tangent.hpp. What the pose optimiser, the bundle adjustment and the covariances
/// share.
namespace weft::slam {

using Matrix36d = Eigen::Matrix<double, 3, 6>;

/// Nearer than this there is no projection: the pixel is computed as if the point were here, so
/// that the cost stays continuous, and the observation is an outlier.
inline constexpr double kMinDepth_m = 0.05;

/// Rows 0 and 1: pixel, row 2: depth along the optical axis (zero where not measured).
struct PointResidual {
  Eigen::Vector3d e;
  Eigen::Matrix3d by_camera_point;  // de / d(point in the camera frame)
  bool in_front;
};

inline PointResidual point_residual(const CameraModel& camera, const PointObservation& seen,
                                    const Eigen::Vector3d& point_camera) {
  PointResidual r;
  r.in_front = point_camera.z() > kMinDepth_m;
  const double inverse_z = 1.0 / (r.in_front ? point_camera.z() : kMinDepth_m);
  const double weight = 1.0 / seen.sigma_px;
  const double a = weight * camera.fx * inverse_z;
  const double b = weight * camera.fy * inverse_z;
  r.e[0] = a * point_camera.x() + weight * (camera.cx - seen.pixel.x());
  r.e[1] = b * point_camera.y() + weight * (camera.cy - seen.pixel.y());
  r.e[2] = 0.0;
  r.by_camera_point.setZero();
  r.by_camera_point(0, 0) = a;
  r.by_camera_point(1, 1) = b;
  if (r.in_front) {
    r.by_camera_point(0, 2) = -a * point_camera.x() * inverse_z;
    r.by_camera_point(1, 2) = -b * point_camera.y() * inverse_z;
  }
  if (seen.depth_m > 0.0) {
    r.e[2] = (point_camera.z() - seen.depth_m) / seen.sigma_depth_m;
    r.by_camera_point(2, 2) = 1.0 / seen.sigma_depth_m;
  }
  return r;
}

/// A plane's observation made ready: e = whitener * (tilt, tilt, distance), the tilt being the
/// landmark's normal in the camera, in the tangent plane of the observed one, with the angle
/// between them as its length.
struct PlaneFactor {
  /// Throws Error when the covariance with its floors is not positive definite.
  PlaneFactor(const PlaneObservation& seen, const PlaneNoise& noise, const std::string& where);

  Eigen::Vector3d normal;
  double distance_m;
  Eigen::Matrix<double, 2, 3> basis;  // rows: plane::tangent_basis(normal)
  Eigen::Matrix3d covariance;         // with its floors
  Eigen::Matrix3d whitener;           // whitener^T whitener = covariance^-1

  /// Not whitened. plane: the landmark; normal_camera = R n_w and its distance in the camera,
  /// before the sign that fits is taken.
  struct Residual {
    Eigen::Vector3d e;
    Eigen::Matrix3d by_normal_camera;  // of e; the last row is zero
    double sign;                       // de[2] / d(distance in the camera)
  };
  Residual residual(const Eigen::Vector3d& normal_camera, double distance_camera_m) const;
};

/// e and its derivatives by the pose's increment, and by the plane's ambient normal and distance
/// (3 x 4), not whitened.
struct PlaneResidual {
  Eigen::Vector3d e;
  Matrix36d by_pose;
  Eigen::Matrix<double, 3, 4> by_plane;
};
PlaneResidual plane_residual(const PlaneFactor& factor, const Eigen::Matrix3d& R_camera_world,
                             const Eigen::Vector3d& t_camera_world,
                             const Eigen::Vector3d& normal_world, double distance_world_m);

/// (rotation vector, translation) of T_camera_object^-1 T_camera_world T_world_object, not
/// whitened.
struct PairResidual {
  Vector6d e;
  Matrix6d by_first;   // camera_world, or a
  Matrix6d by_second;  // world_object, or b
};
PairResidual object_residual(const Rigid3d& T_camera_object, const Rigid3d& T_camera_world,
                             const Rigid3d& T_world_object);
/// The same of T_a_b^-1 T_a_world T_b_world^-1.
PairResidual relative_residual(const Rigid3d& T_a_b, const Rigid3d& T_a_world,
                               const Rigid3d& T_b_world);

/// W with W^T W = information. Throws Error naming `where` when it is not positive definite.
Matrix6d square_root(const Matrix6d& information, const std::string& where);

/// Each throws Error naming `where` and the value that cannot be.
void check_pose(const Rigid3d& pose, const std::string& where);
void check_plane(const PlaneState& plane, const std::string& where);
void check_observation(const PointObservation& seen, std::size_t points, const std::string& where);
void check_observation(const PlaneObservation& seen, std::size_t planes, const std::string& where);

}  // namespace weft::slam
