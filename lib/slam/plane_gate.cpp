#include "slam/plane_gate.hpp"

#include <Eigen/Cholesky>

#include "base/error.hpp"
#include "plane/extractor.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

/// Columns: what a change of (tilt, tilt, distance) does to (normal, distance).
Eigen::Matrix<double, 4, 3> plane_tangents(const Eigen::Vector3d& normal) {
  const auto [e0, e1] = plane::tangent_basis(normal);
  Eigen::Matrix<double, 4, 3> tangents = Eigen::Matrix<double, 4, 3>::Zero();
  tangents.block<3, 1>(0, 0) = e0;
  tangents.block<3, 1>(0, 1) = e1;
  tangents(3, 2) = 1.0;
  return tangents;
}

}  // namespace

rgbd::Plane in_camera(const PlaneState& plane, const Rigid3d& T_camera_world) {
  rgbd::Plane out;
  out.normal = T_camera_world.rotation * plane.normal_world;
  out.distance_m = plane.distance_m + out.normal.dot(T_camera_world.translation);
  if (out.distance_m > 0.0) {
    out.normal = -out.normal;
    out.distance_m = -out.distance_m;
  }
  return out;
}

PlaneState in_world(const rgbd::Plane& plane_camera, const Rigid3d& T_camera_world) {
  return {T_camera_world.rotation.conjugate() * plane_camera.normal,
          plane_camera.distance_m - plane_camera.normal.dot(T_camera_world.translation), false};
}

Eigen::Matrix3d covariance_in_world(const rgbd::Plane& plane_camera,
                                    const Eigen::Matrix3d& covariance_camera,
                                    const Rigid3d& T_camera_world,
                                    const Matrix6d& pose_covariance) {
  check_pose(T_camera_world, "the camera of a plane");
  const Eigen::Matrix3d back = T_camera_world.rotation.conjugate().toRotationMatrix();
  const Eigen::Vector3d& n = plane_camera.normal;
  const Eigen::Vector3d& t = T_camera_world.translation;
  // n_w = R^T n_c and d_w = d_c - n_c . t, with R <- exp(w) R and t <- t + v.
  Eigen::Matrix4d by_plane = Eigen::Matrix4d::Zero();
  by_plane.topLeftCorner<3, 3>() = back;
  by_plane.bottomLeftCorner<1, 3>() = -t.transpose();
  by_plane(3, 3) = 1.0;
  Eigen::Matrix<double, 4, 6> by_pose = Eigen::Matrix<double, 4, 6>::Zero();
  by_pose.topLeftCorner<3, 3>() = back * skew(n);
  by_pose.bottomRightCorner<1, 3>() = -n.transpose();
  const auto onto = plane_tangents(back * n);
  const Eigen::Matrix3d J = onto.transpose() * by_plane * plane_tangents(n);
  const Matrix36d K = onto.transpose() * by_pose;
  return J * covariance_camera * J.transpose() + K * pose_covariance * K.transpose();
}

double plane_distance(const PlaneState& plane, const Eigen::Matrix3d& plane_covariance,
                      const PlaneObservation& observation, const Rigid3d& T_camera_world,
                      const Matrix6d& pose_covariance, const PlaneNoise& noise) {
  check_plane(plane, "a plane of the map");
  check_pose(T_camera_world, "the camera of a plane");
  check_observation(observation, static_cast<std::size_t>(observation.plane) + 1,
                    "a plane's observation");
  const PlaneFactor factor(observation, noise, "a plane's observation");
  const PlaneResidual r =
      plane_residual(factor, T_camera_world.rotation.toRotationMatrix(), T_camera_world.translation,
                     plane.normal_world, plane.distance_m);
  const Eigen::Matrix3d by_plane = r.by_plane * plane_tangents(plane.normal_world);
  const Eigen::Matrix3d covariance = factor.covariance +
                                     by_plane * plane_covariance * by_plane.transpose() +
                                     r.by_pose * pose_covariance * r.by_pose.transpose();
  const Eigen::LLT<Eigen::Matrix3d> decomposition(covariance);
  if (!covariance.allFinite() || decomposition.info() != Eigen::Success) {
    throw Error("plane association: the sum of the covariances is not positive definite");
  }
  return decomposition.matrixL().solve(r.e).squaredNorm();
}

}  // namespace weft::slam
