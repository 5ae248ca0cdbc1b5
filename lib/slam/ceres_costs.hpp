#pragma once

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>
#include <ceres/sized_cost_function.h>
#include <ceres/sphere_manifold.h>

#include "slam/residuals.hpp"

/// The factors of residuals.hpp as Ceres wants them. A pose is 7 numbers: the quaternion as Eigen
/// stores it, then the translation; a plane 4: normal and distance; a point 3.
namespace weft::slam {

using PoseManifold =
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;
using PlaneManifold = ceres::ProductManifold<ceres::SphereManifold<3>, ceres::EuclideanManifold<1>>;

using PoseBlock = std::array<double, 7>;
using PlaneBlock = std::array<double, 4>;

PoseBlock to_block(const Rigid3d& pose);
Rigid3d to_pose(const double* block);

/// Derivative of the pose's increment (tangent.hpp) by the seven numbers. Along the sphere of unit
/// quaternions it is exact, and that is all the manifold looks at.
Eigen::Matrix<double, 6, 7, Eigen::RowMajor> increment_by_block(const double* block);

template <int Dimension>  // 2: pixel, 3: pixel and depth
class PointCost final : public ceres::SizedCostFunction<Dimension, 7, 3> {
 public:
  PointCost(const CameraModel& camera, const PointObservation& seen)
      : camera_(camera), seen_(seen) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const CameraModel& camera_;
  const PointObservation& seen_;
};

class PlaneCost final : public ceres::SizedCostFunction<3, 7, 4> {
 public:
  explicit PlaneCost(const PlaneFactor& factor) : factor_(factor) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const PlaneFactor& factor_;
};

/// An object's pose seen from a camera, or one camera's pose seen from another.
class PairCost final : public ceres::SizedCostFunction<6, 7, 7> {
 public:
  using Residual = PairResidual (*)(const Rigid3d& measured, const Rigid3d& first,
                                    const Rigid3d& second);
  PairCost(Residual residual, const Rigid3d& measured, const Matrix6d& root_information)
      : residual_(residual), measured_(measured), root_information_(root_information) {}
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Residual residual_;
  Rigid3d measured_;
  Matrix6d root_information_;
};

}  // namespace weft::slam
