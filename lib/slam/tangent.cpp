#include "slam/tangent.hpp"

#include <cmath>

namespace weft::slam {

Eigen::Quaterniond exp_rotation(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  // sin(angle / 2) / angle
  const double factor = angle < 1e-4 ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
  const Eigen::Vector3d v = factor * omega;
  return Eigen::Quaterniond(std::cos(0.5 * angle), v.x(), v.y(), v.z()).normalized();
}

Eigen::Vector3d log_rotation(const Eigen::Quaterniond& rotation) {
  const double sign = rotation.w() < 0.0 ? -1.0 : 1.0;  // q and -q are the same rotation
  const Eigen::Vector3d v = sign * rotation.vec();
  const double sine = v.norm();
  const double cosine = sign * rotation.w();
  if (sine < 1e-5) return (2.0 / cosine) * (1.0 - sine * sine / (3.0 * cosine * cosine)) * v;
  return (2.0 * std::atan2(sine, cosine) / sine) * v;
}

Eigen::Matrix3d left_jacobian_inverse(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  const double half = 0.5 * angle;
  // (1 - half cot half) / angle^2
  const double factor = angle < 1e-3
                            ? 1.0 / 12.0 + angle * angle / 720.0
                            : (1.0 - half * std::cos(half) / std::sin(half)) / (angle * angle);
  const Eigen::Matrix3d cross = skew(omega);
  return Eigen::Matrix3d::Identity() - 0.5 * cross + factor * cross * cross;
}

Rigid3d plus(const Rigid3d& T_a_b, const Vector6d& increment) {
  return {(exp_rotation(increment.head<3>()) * T_a_b.rotation).normalized(),
          T_a_b.translation + increment.tail<3>()};
}

Vector6d minus(const Rigid3d& T_to, const Rigid3d& T_from) {
  Vector6d increment;
  increment << log_rotation(T_to.rotation * T_from.rotation.conjugate()),
      T_to.translation - T_from.translation;
  return increment;
}

}  // namespace weft::slam
