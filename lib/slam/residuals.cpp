#include "slam/residuals.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>

#include "base/error.hpp"
#include "plane/extractor.hpp"

namespace weft::slam {
namespace {

bool is_unit(double norm) { return std::abs(norm - 1.0) < 1e-6; }

void check_index(int index, std::size_t count, const char* what, const std::string& where) {
  if (index < 0 || static_cast<std::size_t>(index) >= count) {
    throw Error(where + " refers to " + what + " " + std::to_string(index) + " of " +
                std::to_string(count));
  }
}

}  // namespace

Eigen::Matrix3d with_floors(const Eigen::Matrix3d& covariance, const PlaneNoise& noise) {
  const double scale = covariance.cwiseAbs().maxCoeff();
  if (!covariance.allFinite() ||
      !(covariance - covariance.transpose()).isZero(1e-9 * std::max(scale, 1e-300))) {
    throw Error("a plane's covariance is not symmetric and finite");
  }
  const double floor_tilt = noise.floor_tilt_deg * std::numbers::pi / 180.0;
  const Eigen::Matrix2d tilt = covariance.topLeftCorner<2, 2>();
  const Eigen::Vector2d cross = covariance.block<2, 1>(0, 2);
  // Where the plane's points are along both tangents: distance = lever . tilt + something
  // independent of the tilt. Without tilt there is no lever to be told.
  const Eigen::LLT<Eigen::Matrix2d> decomposition(tilt);
  const double determinant = tilt.determinant();
  Eigen::Vector2d lever = Eigen::Vector2d::Zero();
  if (decomposition.info() == Eigen::Success && determinant > 1e-12 * tilt.trace() * tilt.trace()) {
    lever = decomposition.solve(cross);
  } else if (tilt.trace() > 0.0) {
    lever = cross / tilt.trace();
  }
  const double rest = covariance(2, 2) - lever.dot(tilt * lever);
  if (tilt(0, 0) < 0.0 || tilt(1, 1) < 0.0 || determinant < -1e-9 * tilt.trace() * tilt.trace() ||
      rest < -1e-9 * std::max(covariance(2, 2), 0.0) - 1e-15) {
    throw Error("a plane's covariance is not positive semidefinite");
  }
  Eigen::Matrix2d raised = tilt;
  for (int k = 0; k < 2; ++k) raised(k, k) = std::max(raised(k, k), floor_tilt * floor_tilt);
  Eigen::Matrix3d out;
  out.topLeftCorner<2, 2>() = raised;
  out.block<2, 1>(0, 2) = raised * lever;
  out.block<1, 2>(2, 0) = out.block<2, 1>(0, 2).transpose();
  out(2, 2) =
      std::max(rest, noise.floor_distance_m * noise.floor_distance_m) + lever.dot(raised * lever);
  return out;
}

PlaneFactor::PlaneFactor(const PlaneObservation& seen, const PlaneNoise& noise,
                         const std::string& where)
    : normal(seen.normal_camera), distance_m(seen.distance_m) {
  const auto [e0, e1] = plane::tangent_basis(normal);
  basis.row(0) = e0.transpose();
  basis.row(1) = e1.transpose();
  try {
    covariance = with_floors(seen.covariance, noise);
  } catch (const Error& e) {
    throw Error(where + ": " + e.what());
  }
  const Eigen::LLT<Eigen::Matrix3d> decomposition(covariance);
  if (decomposition.info() != Eigen::Success) {
    throw Error(where + ": its covariance is not positive definite; give it floors");
  }
  whitener = decomposition.matrixL().solve(Eigen::Matrix3d::Identity());
}

PlaneFactor::Residual PlaneFactor::residual(const Eigen::Vector3d& normal_camera,
                                            double distance_camera_m) const {
  Residual r;
  r.sign = normal_camera.dot(normal) < 0.0 ? -1.0 : 1.0;
  const Eigen::Vector3d n = r.sign * normal_camera;
  const Eigen::Vector2d across = basis * n;
  const double sine = across.norm();
  const double cosine = normal.dot(n);
  const double angle = std::atan2(sine, cosine);
  // angle / sin(angle), and its derivative by cos(angle)
  double ratio, slope;
  if (angle < 1e-3) {
    ratio = 1.0 + angle * angle / 6.0;
    slope = -1.0 / 3.0 - 2.0 * angle * angle / 15.0;
  } else {
    ratio = angle / sine;
    slope = (angle * cosine - sine) / (sine * sine * sine);
  }
  r.e.head<2>() = ratio * across;
  r.e[2] = r.sign * distance_camera_m - distance_m;
  r.by_normal_camera.topRows<2>() = r.sign * (ratio * basis + slope * across * normal.transpose());
  r.by_normal_camera.row(2).setZero();
  return r;
}

PlaneResidual plane_residual(const PlaneFactor& factor, const Eigen::Matrix3d& R_camera_world,
                             const Eigen::Vector3d& t_camera_world,
                             const Eigen::Vector3d& normal_world, double distance_world_m) {
  // n_c = R n_w; the plane n_w . x_w = d_w holds n_c . x_c = d_w + n_c . t.
  const Eigen::Vector3d n = R_camera_world * normal_world;
  const auto inner = factor.residual(n, distance_world_m + n.dot(t_camera_world));
  Eigen::Matrix3d by_normal = inner.by_normal_camera;
  by_normal.row(2) = inner.sign * t_camera_world.transpose();
  PlaneResidual r;
  r.e = inner.e;
  r.by_pose.leftCols<3>() = -by_normal * skew(n);
  r.by_pose.rightCols<3>().setZero();
  r.by_pose.bottomRightCorner<1, 3>() = inner.sign * n.transpose();
  r.by_plane.leftCols<3>() = by_normal * R_camera_world;
  r.by_plane.col(3) = Eigen::Vector3d(0.0, 0.0, inner.sign);
  return r;
}

PairResidual object_residual(const Rigid3d& T_camera_object, const Rigid3d& T_camera_world,
                             const Rigid3d& T_world_object) {
  const Eigen::Matrix3d back = T_camera_object.rotation.conjugate().toRotationMatrix();
  const Eigen::Matrix3d R = T_camera_world.rotation.toRotationMatrix();
  const Eigen::Vector3d lever = R * T_world_object.translation;
  PairResidual r;
  r.e.head<3>() = log_rotation(T_camera_object.rotation.conjugate() * T_camera_world.rotation *
                               T_world_object.rotation);
  r.e.tail<3>() = back * (lever + T_camera_world.translation - T_camera_object.translation);
  const Eigen::Matrix3d by_log = left_jacobian_inverse(r.e.head<3>());
  r.by_first << by_log * back, Eigen::Matrix3d::Zero(), -back * skew(lever), back;
  r.by_second << by_log * back * R, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero(), back * R;
  return r;
}

PairResidual relative_residual(const Rigid3d& T_a_b, const Rigid3d& T_a_world,
                               const Rigid3d& T_b_world) {
  const Eigen::Matrix3d back = T_a_b.rotation.conjugate().toRotationMatrix();
  const Eigen::Quaterniond q_error =
      T_a_b.rotation.conjugate() * T_a_world.rotation * T_b_world.rotation.conjugate();
  const Eigen::Matrix3d R_error = q_error.toRotationMatrix();
  // t_b carried into a's frame
  const Eigen::Vector3d lever =
      T_a_world.rotation * (T_b_world.rotation.conjugate() * T_b_world.translation);
  PairResidual r;
  r.e.head<3>() = log_rotation(q_error);
  r.e.tail<3>() = back * (T_a_world.translation - lever - T_a_b.translation);
  const Eigen::Matrix3d by_log = left_jacobian_inverse(r.e.head<3>());
  r.by_first << by_log * back, Eigen::Matrix3d::Zero(), back * skew(lever), back;
  r.by_second << -by_log * R_error, Eigen::Matrix3d::Zero(), -R_error * skew(T_b_world.translation),
      -R_error;
  return r;
}

Matrix6d square_root(const Matrix6d& information, const std::string& where) {
  const Eigen::LLT<Matrix6d> decomposition(information);
  if (!information.allFinite() || decomposition.info() != Eigen::Success) {
    throw Error(where + ": its information matrix is not finite and positive definite");
  }
  return decomposition.matrixU();
}

void check_pose(const Rigid3d& pose, const std::string& where) {
  if (!pose.translation.allFinite() || !is_unit(pose.rotation.norm())) {
    throw Error(where + ": its pose is not finite with a quaternion of unit length");
  }
}

void check_plane(const PlaneState& plane, const std::string& where) {
  if (!std::isfinite(plane.distance_m) || !is_unit(plane.normal_world.norm())) {
    throw Error(where + ": it is not finite with a normal of unit length");
  }
}

void check_observation(const PointObservation& seen, std::size_t points, const std::string& where) {
  check_index(seen.point, points, "point", where);
  if (!seen.pixel.allFinite() || !std::isfinite(seen.sigma_px) || !(seen.sigma_px > 0.0) ||
      !std::isfinite(seen.depth_m) || seen.depth_m < 0.0 ||
      (seen.depth_m > 0.0 && (!std::isfinite(seen.sigma_depth_m) || !(seen.sigma_depth_m > 0.0)))) {
    throw Error(where + ": pixel (" + std::to_string(seen.pixel.x()) + ", " +
                std::to_string(seen.pixel.y()) + ") +- " + std::to_string(seen.sigma_px) +
                " px, depth " + std::to_string(seen.depth_m) + " +- " +
                std::to_string(seen.sigma_depth_m) +
                " m; expected finite values, depth 0 or more and positive deviations");
  }
}

void check_observation(const PlaneObservation& seen, std::size_t planes, const std::string& where) {
  check_index(seen.plane, planes, "plane", where);
  if (!std::isfinite(seen.distance_m) || !is_unit(seen.normal_camera.norm())) {
    throw Error(where + ": it is not finite with a normal of unit length");
  }
}

}  // namespace weft::slam
