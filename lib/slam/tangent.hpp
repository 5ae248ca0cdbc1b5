#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "slam/rigid3d.hpp"

namespace weft::slam {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Matrix with skew(a) * b = a x b.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

/// Rotation by |omega| radians about omega.
Eigen::Quaterniond exp_rotation(const Eigen::Vector3d& omega);
/// The shortest omega with exp_rotation(omega) = rotation; |omega| <= pi.
Eigen::Vector3d log_rotation(const Eigen::Quaterniond& rotation);
/// Inverse of the left Jacobian of SO(3): log(exp(d) exp(omega)) = omega + left_jacobian_inverse(
/// omega) d to first order in d. Defined for |omega| < 2 pi.
Eigen::Matrix3d left_jacobian_inverse(const Eigen::Vector3d& omega);

/// The increment all poses of lib/slam are corrected by and whose covariance they report:
/// (rotation vector in the frame a [rad], translation [m]), R_a_b <- exp(w) R_a_b and
/// t_a_b <- t_a_b + v.
Rigid3d plus(const Rigid3d& T_a_b, const Vector6d& increment);
/// The increment with plus(T_from, increment) = T_to.
Vector6d minus(const Rigid3d& T_to, const Rigid3d& T_from);

}  // namespace weft::slam
