#include "plane/cylinder.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "base/random.hpp"

namespace weft::plane {
namespace {

const Eigen::Vector3d kAxis = Eigen::Vector3d(0.2, 1.0, -0.3).normalized();
const Eigen::Vector3d kPoint(0.1, -0.2, 1.4);

/// Oriented points on 120 degrees of a cylinder.
std::vector<OrientedPoint> on_cylinder(double radius_m, bool convex, double noise_m, int count) {
  Random random(5);
  const Eigen::Vector3d e0 = -(Eigen::Vector3d::UnitZ() - kAxis * kAxis.z()).normalized();
  const Eigen::Vector3d e1 = kAxis.cross(e0);
  std::vector<OrientedPoint> points;
  for (int i = 0; i < count; ++i) {
    const double angle = random.uniform(-1.05, 1.05), along = random.uniform(-0.3, 0.3);
    const Eigen::Vector3d out = std::cos(angle) * e0 + std::sin(angle) * e1;
    const Eigen::Vector3d noise(random.normal(), random.normal(), random.normal());
    points.push_back(
        {kPoint + along * kAxis + radius_m * out + noise_m * noise,
         ((convex ? 1.0 : -1.0) * out + 3.0 * noise_m / 0.03 * 0.1 * noise).normalized(),
         0.004 + 3.0 * noise_m});
  }
  return points;
}

TEST(Cylinder, IsFoundAmongOtherPoints) {
  for (const bool convex : {true, false})
    for (const double noise_m : {0.0, 0.002}) {
      auto points = on_cylinder(0.15, convex, noise_m, 60);
      for (int i = 0; i < 30; ++i) points.push_back({{0.02 * i, 0.5, 2.0}, {0.0, 0.0, -1.0}, 0.01});
      const auto fit = fit_cylinder(points, 20, 0.5, 15.0, 50.0, 1);
      ASSERT_TRUE(fit);
      EXPECT_EQ(fit->cylinder.convex, convex);
      EXPECT_NEAR(fit->cylinder.radius_m, 0.15, 1e-9 + 2.0 * noise_m);
      EXPECT_GT(std::abs(fit->cylinder.axis.dot(kAxis)), noise_m > 0.0 ? 0.9996 : 1.0 - 1e-9);
      const Eigen::Vector3d off = fit->cylinder.point - kPoint;
      EXPECT_LT((off - kAxis * kAxis.dot(off)).norm(), 1e-9 + 3.0 * noise_m);
      EXPECT_GE(fit->inliers.size(), 55u);
      EXPECT_LT(fit->inliers.back(), 60);
      double squares = 0.0;
      for (const int i : fit->inliers) {
        const Eigen::Vector3d from =
            points[static_cast<std::size_t>(i)].point - fit->cylinder.point;
        const double height = fit->cylinder.axis.cross(from).norm() - fit->cylinder.radius_m;
        EXPECT_NEAR(fit->cylinder.height_m(points[static_cast<std::size_t>(i)].point), height,
                    1e-12);
        squares += height * height;
      }
      EXPECT_NEAR(fit->rms_m, std::sqrt(squares / static_cast<double>(fit->inliers.size())), 1e-12);
    }
}

TEST(Cylinder, IsNotSeenWhereThereIsNone) {
  const auto points = on_cylinder(0.15, true, 0.001, 60);
  EXPECT_FALSE(fit_cylinder(points, 61, 0.5, 15.0, 50.0, 1));
  EXPECT_FALSE(fit_cylinder(points, 20, 0.1, 15.0, 50.0, 1));   // too thick
  EXPECT_FALSE(fit_cylinder(points, 20, 0.5, 15.0, 170.0, 1));  // too little of it seen
  EXPECT_FALSE(fit_cylinder({}, 3, 0.5, 15.0, 50.0, 1));
  Random random(2);
  std::vector<OrientedPoint> flat;
  for (int i = 0; i < 60; ++i)
    flat.push_back(
        {{random.uniform(), random.uniform(), 2.0},
         Eigen::Vector3d(0.03 * random.normal(), 0.03 * random.normal(), -1.0).normalized(),
         0.004});
  EXPECT_FALSE(fit_cylinder(flat, 20, 0.5, 15.0, 50.0, 1));
}

}  // namespace
}  // namespace weft::plane
