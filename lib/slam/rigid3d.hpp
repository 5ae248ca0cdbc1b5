#pragma once

#include <Eigen/Geometry>

namespace weft::slam {

/// Rigid transform x_a = rotation * x_b + translation, named T_a_b. The quaternion is of unit
/// length, in the order Eigen stores it (x, y, z, w), as ceres::EigenQuaternionManifold wants it.
struct Rigid3d {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  // metres

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation * point + translation;
  }
  /// T_a_c = T_a_b * T_b_c, normalised.
  Rigid3d operator*(const Rigid3d& other) const {
    return {(rotation * other.rotation).normalized(), *this * other.translation};
  }
  Rigid3d inverse() const {
    const Eigen::Quaterniond back = rotation.conjugate();
    return {back, -(back * translation)};
  }
};

}  // namespace weft::slam
