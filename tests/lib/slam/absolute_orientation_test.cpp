#include "slam/absolute_orientation.hpp"

#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <limits>

#include "base/error.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

using test::any_pose;
using test::gauss3;
using test::unit3;

PointPair pair_of(const Rigid3d& T_a_b, const Eigen::Vector3d& point_b, double sigma_m = 0.01) {
  return {T_a_b * point_b, point_b, sigma_m};
}
PlanePair planes_of(const Rigid3d& T_a_b, const Eigen::Vector3d& normal_b, double distance_b_m) {
  PlanePair p;
  p.normal_b = normal_b;
  p.distance_b_m = distance_b_m;
  p.normal_a = T_a_b.rotation * normal_b;
  p.distance_a_m = distance_b_m + p.normal_a.dot(T_a_b.translation);
  return p;
}
double error(const std::optional<Rigid3d>& found, const Rigid3d& truth) {
  return found ? minus(*found, truth).norm() : std::numeric_limits<double>::infinity();
}

TEST(AbsoluteOrientation, IsExactForExactPairsOfEveryMinimalKind) {
  Random random(1);
  for (int i = 0; i < 30; ++i) {
    const Rigid3d T = any_pose(random);
    std::vector<PointPair> points;
    for (int k = 0; k < 3; ++k) points.push_back(pair_of(T, gauss3(random)));
    const std::vector<PlanePair> planes{planes_of(T, {1, 0, 0}, 0.4),
                                        planes_of(T, Eigen::Vector3d(0.6, 0.8, 0), -1.0),
                                        planes_of(T, Eigen::Vector3d(0.1, 0.2, 1).normalized(), 2)};
    const auto of = [&](std::size_t p, std::size_t q) {
      return absolute_orientation(std::span(points).first(p), std::span(planes).first(q));
    };
    EXPECT_LT(error(of(3, 0), T), 1e-9);
    EXPECT_LT(error(of(0, 3), T), 1e-9);
    EXPECT_LT(error(of(1, 2), T), 1e-9);
    EXPECT_LT(error(of(2, 1), T), 1e-9);
    EXPECT_LT(error(of(3, 3), T), 1e-9);
    EXPECT_FALSE(of(0, 0));
    EXPECT_FALSE(of(2, 0));
    EXPECT_FALSE(of(0, 2));
    EXPECT_FALSE(of(1, 1));
  }
}

TEST(AbsoluteOrientation, SaysWhenItIsNotDetermined) {
  const Rigid3d T{exp_rotation({0.1, 0.2, 0.3}), {1, 2, 3}};
  std::vector<PointPair> line;
  for (int k = 0; k < 5; ++k) line.push_back(pair_of(T, {0.1 * k, 0.2 * k, 1.0}));
  EXPECT_FALSE(absolute_orientation(line, {}));
  const std::vector<PlanePair> parallel{planes_of(T, {0, 0, 1}, 0.0), planes_of(T, {0, 0, 1}, 1.0)};
  EXPECT_FALSE(absolute_orientation(std::span(line).first(1), parallel));
  // Three planes with a common direction: the rotation is known, sliding along it is not.
  const std::vector<PlanePair> prism{planes_of(T, {1, 0, 0}, 0.0), planes_of(T, {0, 1, 0}, 1.0),
                                     planes_of(T, Eigen::Vector3d(1, 1, 0).normalized(), 1.0)};
  EXPECT_FALSE(absolute_orientation({}, prism));
  // Two points whose line stands upright on the plane.
  const std::vector<PointPair> upright{pair_of(T, {0, 0, 0}), pair_of(T, {0, 0, 1})};
  EXPECT_FALSE(absolute_orientation(upright, std::span(parallel).first(1)));
}

TEST(AbsoluteOrientation, NeverMirrors) {
  // Coplanar and noisy: the unconstrained optimum is often a reflection.
  Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Rigid3d T = any_pose(random);
    std::vector<PointPair> points;
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector3d g = gauss3(random);
      points.push_back(pair_of(T, {g.x(), g.y(), 0.0}));
      points.back().point_a += 0.05 * gauss3(random);
    }
    const auto found = absolute_orientation(points, {});
    if (found) {
      EXPECT_LT(found->rotation.angularDistance(T.rotation), 0.8);
    }
  }
}

TEST(AbsoluteOrientation, IsTheLeastWeightedSquares) {
  Random random(3);
  const Rigid3d T = any_pose(random);
  std::vector<PointPair> points;
  for (int k = 0; k < 20; ++k) {
    points.push_back(pair_of(T, gauss3(random), k % 2 ? 0.01 : 0.05));
    points.back().point_a += points.back().sigma_m * gauss3(random);
  }
  const auto found = absolute_orientation(points, {});
  ASSERT_TRUE(found);
  const auto cost = [&](const Rigid3d& at) {
    double sum = 0.0;
    for (const auto& p : points) {
      sum += (p.point_a - at * p.point_b).squaredNorm() / (p.sigma_m * p.sigma_m);
    }
    return sum;
  };
  for (int i = 0; i < 200; ++i) {
    EXPECT_GE(cost(plus(*found, test::gauss6(random, 1e-3, 1e-3))), cost(*found));
  }
}

TEST(RansacOrientation, FindsTheMotionAmongFalseMatches) {
  Random random(4);
  for (int seed = 1; seed <= 20; ++seed) {
    const Rigid3d T = any_pose(random);
    std::vector<PointPair> points;
    for (int k = 0; k < 120; ++k) {
      points.push_back(pair_of(T, 2.0 * gauss3(random), 0.02));
      points.back().point_a += 0.02 * gauss3(random);
      if (k % 3 != 0) points.back().point_a = 2.0 * gauss3(random);  // two thirds are false
    }
    const auto found = ransac_absolute_orientation(points, {}, {.max_iterations = 1000});
    ASSERT_TRUE(found);
    EXPECT_LT(minus(found->T_a_b, T).norm(), 0.03);
    EXPECT_GE(found->point_inliers, 34);
    int counted = 0;
    for (std::size_t k = 0; k < points.size(); ++k) {
      counted += found->point_inlier[k];
      if (k % 3 != 0) {
        EXPECT_EQ(found->point_inlier[k], 0);
      }
    }
    EXPECT_EQ(counted, found->point_inliers);
  }
}

TEST(RansacOrientation, PlanesHelpWherePointsAreFewOrFalse) {
  Random random(5);
  for (int seed = 1; seed <= 20; ++seed) {
    const Rigid3d T = any_pose(random);
    std::vector<PlanePair> planes{planes_of(T, {1, 0, 0}, 1.0), planes_of(T, {0, 1, 0}, -1.0),
                                  planes_of(T, {0, 0, 1}, -2.0)};
    planes[2].distance_a_m += 1.0;  // one false association
    std::vector<PointPair> points;
    for (int k = 0; k < 60; ++k) {
      points.push_back(pair_of(T, gauss3(random), 0.02));
      points.back().point_a += 0.02 * gauss3(random);
      if (k >= 6) points.back().point_a = 2.0 * gauss3(random);  // nine in ten are false
    }
    const RansacOptions options{.max_iterations = 2000, .min_points = 4};
    const auto found = ransac_absolute_orientation(points, planes, options);
    ASSERT_TRUE(found);
    EXPECT_LT(minus(found->T_a_b, T).norm(), 0.06);
    EXPECT_EQ(found->plane_inliers, 2);
    EXPECT_EQ(found->plane_inlier[2], 0);
  }
}

TEST(RansacOrientation, PlanesAloneDoWhereAsked) {
  Random random(6);
  const Rigid3d T = any_pose(random);
  const std::vector<PlanePair> planes{planes_of(T, {1, 0, 0}, 1.0), planes_of(T, {0, 1, 0}, -1.0),
                                      planes_of(T, {0, 0, 1}, -2.0)};
  EXPECT_FALSE(ransac_absolute_orientation({}, planes));
  const auto found = ransac_absolute_orientation({}, planes, {.min_points = 0});
  ASSERT_TRUE(found);
  EXPECT_LT(minus(found->T_a_b, T).norm(), 1e-9);
  EXPECT_EQ(found->plane_inliers, 3);
}

TEST(RansacOrientation, NothingToFindIsNothing) {
  Random random(7);
  std::vector<PointPair> points;
  EXPECT_FALSE(ransac_absolute_orientation(points, {}));
  for (int k = 0; k < 50; ++k) points.push_back({gauss3(random), gauss3(random), 0.01});
  EXPECT_FALSE(ransac_absolute_orientation(points, {}));
}

TEST(RansacOrientation, StopsEarlyWhenAllAgreeAndRepeatsItself) {
  Random random(8);
  const Rigid3d T = any_pose(random);
  std::vector<PointPair> points;
  for (int k = 0; k < 100; ++k) points.push_back(pair_of(T, gauss3(random)));
  const auto a = ransac_absolute_orientation(points, {});
  const auto b = ransac_absolute_orientation(points, {});
  ASSERT_TRUE(a && b);
  EXPECT_LT(a->iterations, 10);
  EXPECT_EQ(a->T_a_b.rotation.coeffs(), b->T_a_b.rotation.coeffs());
  EXPECT_EQ(a->T_a_b.translation, b->T_a_b.translation);
}

TEST(RansacOrientation, WhatCannotBeIsRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<PointPair> points(3);
  points[1].point_b.x() = nan;
  EXPECT_THROW(ransac_absolute_orientation(points, {}), Error);
  points[1] = {};
  points[2].sigma_m = 0.0;
  EXPECT_THROW(absolute_orientation(points, {}), Error);
  std::vector<PlanePair> planes(2);
  planes[0].normal_a *= 2.0;
  EXPECT_THROW(absolute_orientation({}, planes), Error);
  planes[0] = {};
  planes[1].distance_b_m = nan;
  EXPECT_THROW(absolute_orientation({}, planes), Error);
}

}  // namespace
}  // namespace weft::slam
