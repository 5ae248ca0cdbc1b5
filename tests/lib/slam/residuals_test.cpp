#include "slam/residuals.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "base/error.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

using test::any_pose;
using test::gauss3;
using test::unit3;

constexpr double kStep = 1e-6;

/// Central differences of f(increment) at zero.
template <int Rows, int Columns, class Function>
Eigen::Matrix<double, Rows, Columns> numeric(const Function& f) {
  Eigen::Matrix<double, Rows, Columns> J;
  for (int k = 0; k < Columns; ++k) {
    Eigen::Matrix<double, Columns, 1> step = Eigen::Matrix<double, Columns, 1>::Zero();
    step[k] = kStep;
    J.col(k) = (f(step) - f(-step)) / (2.0 * kStep);
  }
  return J;
}

PlaneObservation observe(Random& random, const Eigen::Vector3d& normal, double distance_m) {
  PlaneObservation seen;
  seen.normal_camera = normal;
  seen.distance_m = distance_m;
  Eigen::Matrix3d root;
  for (double& value : root.reshaped()) value = 0.02 * test::gauss(random);
  seen.covariance = root * root.transpose();
  return seen;
}

TEST(Tangent, ExpAndLogAreInverse) {
  Random random(3);
  for (const double angle : {0.0, 1e-9, 1e-6, 2e-5, 1e-3, 0.1, 1.0, 3.0, 3.14159}) {
    const Eigen::Vector3d omega = angle * unit3(random);
    EXPECT_LT((log_rotation(exp_rotation(omega)) - omega).norm(), 1e-12 + 1e-9 * angle) << angle;
    const Eigen::AngleAxisd oracle(angle,
                                   angle > 0 ? omega.normalized() : Eigen::Vector3d::UnitX());
    EXPECT_LT((exp_rotation(omega).toRotationMatrix() - oracle.toRotationMatrix()).norm(), 1e-12);
    const Eigen::Quaterniond q = exp_rotation(omega);
    const Eigen::Quaterniond negative(-q.w(), -q.x(), -q.y(), -q.z());
    EXPECT_LT((log_rotation(negative) - omega).norm(), 1e-12 + 1e-9 * angle);
  }
}

TEST(Tangent, LeftJacobianInverseIsTheDerivativeOfTheLogarithm) {
  Random random(4);
  for (const double angle : {0.0, 1e-5, 9e-4, 1.1e-3, 0.3, 1.0, 3.0}) {
    const Eigen::Quaterniond q = exp_rotation(angle * unit3(random));
    const auto J =
        numeric<3, 3>([&](const Eigen::Vector3d& d) { return log_rotation(exp_rotation(d) * q); });
    EXPECT_LT((J - left_jacobian_inverse(log_rotation(q))).norm(), 1e-7) << angle;
  }
}

TEST(Tangent, MinusUndoesPlus) {
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const Rigid3d T = any_pose(random);
    const Vector6d step = test::gauss6(random, 0.5, 1.0);
    EXPECT_LT((minus(plus(T, step), T) - step).norm(), 1e-12);
  }
}

TEST(PointResidual, DerivativesAreTheNumericOnes) {
  Random random(6);
  const CameraModel camera = test::kinect();
  for (int i = 0; i < 50; ++i) {
    PointObservation seen;
    seen.pixel = {300, 200};
    seen.sigma_px = 1.5;
    if (i % 2) {
      seen.depth_m = 1.7;
      seen.sigma_depth_m = 0.02;
    }
    const Rigid3d T = any_pose(random);
    // Behind the camera too, where the projection is clamped.
    const Eigen::Vector3d in_camera(random.uniform(-1, 1), random.uniform(-1, 1),
                                    i % 5 == 0 ? random.uniform(-2, 0) : random.uniform(0.3, 4));
    const Eigen::Vector3d world = T.inverse() * in_camera;
    const auto r = point_residual(camera, seen, T * world);
    EXPECT_EQ(r.in_front, i % 5 != 0);
    Matrix36d by_pose;
    by_pose << -r.by_camera_point * skew(T.rotation * world), r.by_camera_point;
    const auto pose_oracle = numeric<3, 6>(
        [&](const Vector6d& d) { return point_residual(camera, seen, plus(T, d) * world).e; });
    EXPECT_LT((by_pose - pose_oracle).norm(), 1e-6 * (1.0 + by_pose.norm()));
    const auto point_oracle = numeric<3, 3>(
        [&](const Eigen::Vector3d& d) { return point_residual(camera, seen, T * (world + d)).e; });
    EXPECT_LT((r.by_camera_point * T.rotation.toRotationMatrix() - point_oracle).norm(),
              1e-6 * (1.0 + point_oracle.norm()));
  }
}

TEST(PlaneResidual, DerivativesAreTheNumericOnes) {
  Random random(7);
  for (int i = 0; i < 60; ++i) {
    const Rigid3d T = any_pose(random);
    const Eigen::Vector3d normal_world = unit3(random);
    const double distance_m = test::gauss(random);
    // From equal planes to planes 80 degrees apart, and the other way round.
    const Eigen::Vector3d n = T.rotation * normal_world;
    const double angle = i < 10 ? 0.0 : i < 20 ? 9e-4 : i < 30 ? 1.1e-3 : random.uniform(0, 1.4);
    const Eigen::Vector3d tilted = exp_rotation(angle * n.cross(unit3(random)).normalized()) * n;
    const auto seen = observe(random, i % 2 ? tilted : Eigen::Vector3d(-tilted), 0.3);
    const PlaneFactor factor(seen, {}, "here");
    const auto at = [&](const Rigid3d& pose, const Eigen::Vector3d& normal, double d) {
      return plane_residual(factor, pose.rotation.toRotationMatrix(), pose.translation, normal, d);
    };
    const PlaneResidual r = at(T, normal_world, distance_m);
    EXPECT_NEAR(r.e.head<2>().norm(), angle, 1e-7);
    const auto pose_oracle = numeric<3, 6>(
        [&](const Vector6d& d) { return at(plus(T, d), normal_world, distance_m).e; });
    EXPECT_LT((r.by_pose - pose_oracle).norm(), 1e-7 * (1.0 + r.by_pose.norm()));
    // On the sphere: along its tangents.
    const auto [e0, e1] = plane::tangent_basis(normal_world);
    Eigen::Matrix<double, 4, 3> tangents = Eigen::Matrix<double, 4, 3>::Zero();
    tangents.block<3, 1>(0, 0) = e0;
    tangents.block<3, 1>(0, 1) = e1;
    tangents(3, 2) = 1.0;
    const auto plane_oracle = numeric<3, 3>([&](const Eigen::Vector3d& d) {
      return at(T, (normal_world + d[0] * e0 + d[1] * e1).normalized(), distance_m + d[2]).e;
    });
    EXPECT_LT((r.by_plane * tangents - plane_oracle).norm(), 1e-7 * (1.0 + plane_oracle.norm()));
  }
}

TEST(PlaneResidual, ATransformedPlaneHoldsItsTransformedPoints) {
  Random random(8);
  for (int i = 0; i < 20; ++i) {
    const Rigid3d T = any_pose(random);
    const Eigen::Vector3d normal = unit3(random);
    const Eigen::Vector3d on_plane = gauss3(random);
    const Eigen::Vector3d n = T.rotation * normal;
    const PlaneFactor factor(observe(random, n, n.dot(T * on_plane)), {}, "here");
    const auto r = plane_residual(factor, T.rotation.toRotationMatrix(), T.translation, normal,
                                  normal.dot(on_plane));
    EXPECT_LT(r.e.norm(), 1e-12);
  }
}

TEST(PairResiduals, DerivativesAreTheNumericOnes) {
  Random random(9);
  for (int i = 0; i < 40; ++i) {
    const Rigid3d A = any_pose(random);
    const Rigid3d B = any_pose(random);
    const Rigid3d error = plus({}, test::gauss6(random, i % 2 ? 0.0 : 0.5, 0.3));
    const auto check = [&](const auto& residual, const Rigid3d& measured) {
      const PairResidual r = residual(measured, A, B);
      const auto first =
          numeric<6, 6>([&](const Vector6d& d) { return residual(measured, plus(A, d), B).e; });
      const auto second =
          numeric<6, 6>([&](const Vector6d& d) { return residual(measured, A, plus(B, d)).e; });
      EXPECT_LT((r.by_first - first).norm(), 1e-7 * (1.0 + first.norm()));
      EXPECT_LT((r.by_second - second).norm(), 1e-7 * (1.0 + second.norm()));
    };
    check(object_residual, A * B * error);
    check(relative_residual, A * B.inverse() * error);
    EXPECT_LT(object_residual(A * B, A, B).e.norm(), 1e-12);
    EXPECT_LT(relative_residual(A * B.inverse(), A, B).e.norm(), 1e-12);
  }
}

TEST(PlaneNoise, FloorsRaiseTheTiltAndTheDistanceAtTheCentroid) {
  // Scatter of points about (0.4, -1.1) along the tangents, hand-worked.
  const Eigen::Vector2d tilt(1e-8, 4e-4), lever(0.4, -1.1);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  const auto compose = [&](const Eigen::Vector2d& t, double at_centroid) {
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    m(0, 0) = t[0];
    m(1, 1) = t[1];
    m(0, 2) = m(2, 0) = t[0] * lever[0];
    m(1, 2) = m(2, 1) = t[1] * lever[1];
    m(2, 2) = at_centroid + lever[0] * lever[0] * t[0] + lever[1] * lever[1] * t[1];
    return m;
  };
  covariance = compose(tilt, 1e-6);
  const double floor_tilt = std::pow(0.5 * std::numbers::pi / 180.0, 2);
  const auto expected = compose({floor_tilt, 4e-4}, 1e-4);
  EXPECT_LT((with_floors(covariance, {}) - expected).norm(), 1e-12);
  EXPECT_LT((with_floors(covariance, test::no_floors()) - covariance).norm(), 1e-15);
  EXPECT_LT((with_floors(Eigen::Matrix3d::Zero(), {}) -
             Eigen::Matrix3d(Eigen::Vector3d(floor_tilt, floor_tilt, 1e-4).asDiagonal()))
                .norm(),
            1e-15);
}

TEST(PlaneNoise, ImpossibleCovariancesAreRefused) {
  Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
  m(0, 1) = 0.5;
  EXPECT_THROW(with_floors(m, {}), Error);  // not symmetric
  m(1, 0) = 0.5;
  EXPECT_NO_THROW(with_floors(m, {}));
  m(0, 1) = m(1, 0) = 1.5;
  EXPECT_THROW(with_floors(m, {}), Error);  // tilt not semidefinite
  m = Eigen::Matrix3d::Identity();
  m(0, 2) = m(2, 0) = 1.5;
  EXPECT_THROW(with_floors(m, {}), Error);  // distance less than its lever asks for
  m(0, 2) = std::nan("");
  EXPECT_THROW(with_floors(m, {}), Error);
  PlaneObservation seen;
  EXPECT_THROW(PlaneFactor(seen, test::no_floors(), "here"), Error);  // zero, and no floors
}

}  // namespace
}  // namespace weft::slam
