#include "slam/pose_optimiser.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cstring>
#include <limits>

#include "base/error.hpp"
#include "slam/residuals.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

struct PoseCase {
  test::World world;
  std::vector<Eigen::Vector3d> points;
  Rigid3d truth;

  explicit PoseCase(test::WorldOptions options) {
    options.cameras = 1;
    world = test::make_world(options);
    for (const auto& point : world.truth.points) points.push_back(point.position_world);
    truth = world.truth.cameras[0].T_camera_world;
  }
  PoseResult solve(const Rigid3d& start, PoseOptions options = {},
                   const std::optional<PosePrior>& prior = std::nullopt) const {
    options.plane_noise = test::no_floors();
    return optimise_pose(world.camera, start, points, world.truth.planes,
                         world.truth.point_observations, world.truth.plane_observations, options,
                         prior);
  }
};

double mahalanobis(const PoseResult& result, const Rigid3d& truth) {
  const Vector6d error = minus(result.T_camera_world, truth);
  return error.dot(result.information * error);
}

TEST(PoseOptimiser, RecoversThePoseWithinItsCovariance) {
  Random random(1);
  double sum = 0.0;
  int cases = 0;
  for (int seed = 1; seed <= 40; ++seed) {
    const PoseCase c({.points = 60, .planes = 3, .seed = seed});
    const auto result = c.solve(plus(c.truth, test::gauss6(random, 0.05, 0.1)));
    EXPECT_EQ(result.observed_directions, 6);
    EXPECT_LT(minus(result.T_camera_world, c.truth).norm(), 0.02);
    sum += mahalanobis(result, c.truth);
    ++cases;
  }
  // Outliers of the 95 % test are left out, so the errors are a little larger than stated.
  EXPECT_TRUE(test::is_plausible_chi_squared(sum / 1.1, 6 * cases)) << sum << " " << 6 * cases;
}

TEST(PoseOptimiser, KeepsAbout95PercentAndTheirChiSquaredIsTheTruncatedOne) {
  double share = 0.0, ratio = 0.0;
  for (int seed = 1; seed <= 20; ++seed) {
    const PoseCase c({.points = 300, .seed = seed, .depth_share = 1.0});
    const auto result = c.solve(c.truth);
    share += result.point_inliers / double(c.world.truth.point_observations.size()) / 20.0;
    ratio += result.chi_squared / (result.degrees_of_freedom + 6) / 20.0;
  }
  // Mean of chi-squared(3) below its 95 % quantile: 3 P(chi2_5 <= 7.815) / 0.95 = 3 * 0.877.
  EXPECT_NEAR(ratio, 0.877, 0.03);
  EXPECT_NEAR(share, 0.95, 0.01);
}

TEST(PoseOptimiser, RejectsFalseMatches) {
  Random random(2);
  PoseCase c({.points = 200, .planes = 4, .seed = 3});
  auto& seen = c.world.truth.point_observations;
  std::vector<bool> is_false(seen.size());
  for (std::size_t i = 0; i < seen.size(); i += 4) {
    seen[i].pixel = {random.uniform(0, 640), random.uniform(0, 480)};
    is_false[i] = true;
  }
  c.world.truth.plane_observations[0].distance_m += 0.5;
  const auto result = c.solve(plus(c.truth, test::gauss6(random, 0.03, 0.05)));
  EXPECT_LT(minus(result.T_camera_world, c.truth).norm(), 0.01);
  int kept_false = 0, lost_true = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    kept_false += is_false[i] && result.point_inlier[i];
    lost_true += !is_false[i] && !result.point_inlier[i];
  }
  EXPECT_LE(kept_false, 1);
  EXPECT_LT(lost_true, 0.1 * double(seen.size()));
  EXPECT_EQ(result.plane_inlier[0], 0);
  EXPECT_EQ(result.plane_inliers, 3);
}

TEST(PoseOptimiser, ThreePlanesAloneDetermineThePose) {
  const PoseCase c({.points = 0, .planes = 3, .sigma_tilt_rad = 1e-4, .sigma_distance_m = 1e-4});
  Random random(5);
  const auto result = c.solve(plus(c.truth, test::gauss6(random, 0.2, 0.3)));
  EXPECT_EQ(result.observed_directions, 6);
  EXPECT_LT(minus(result.T_camera_world, c.truth).norm(), 1e-3);
}

TEST(PoseOptimiser, OnePlaneKeepsTheStartAlongWhatItDoesNotTell) {
  // The floor: turning about its normal and sliding on it are unobserved.
  PoseCase c({.points = 0, .planes = 1, .sigma_tilt_rad = 1e-4, .sigma_distance_m = 1e-4});
  const Eigen::Vector3d normal = c.world.truth.planes[0].normal_world;
  Random random(6);
  const Rigid3d start = plus(c.truth, test::gauss6(random, 0.1, 0.2));
  const auto result = c.solve(start);
  EXPECT_EQ(result.observed_directions, 3);
  EXPECT_EQ(result.plane_inliers, 1);
  const Eigen::Vector3d n_c = result.T_camera_world.rotation * normal;
  EXPECT_LT((n_c - c.truth.rotation * normal).norm(), 1e-3);
  // The translation only moved along the normal.
  const Eigen::Vector3d moved = result.T_camera_world.translation - start.translation;
  EXPECT_LT((moved - n_c * n_c.dot(moved)).norm(), 0.03);
  EXPECT_GT(moved.norm(), 0.05);
  // And it did not turn about it.
  const Eigen::Vector3d turned =
      log_rotation(result.T_camera_world.rotation * start.rotation.conjugate());
  EXPECT_LT(std::abs(turned.dot(n_c)), 0.02);
}

TEST(PoseOptimiser, TwoPlanesLeaveOneDirection) {
  const PoseCase c({.points = 0, .planes = 2, .sigma_tilt_rad = 1e-4, .sigma_distance_m = 1e-4});
  Random random(7);
  const Rigid3d start = plus(c.truth, test::gauss6(random, 0.1, 0.2));
  const auto result = c.solve(start);
  EXPECT_EQ(result.observed_directions, 5);
  EXPECT_LT(result.T_camera_world.rotation.angularDistance(c.truth.rotation), 1e-3);
  // The free direction is that of the planes' common line.
  const Eigen::Vector3d along =
      result.T_camera_world.rotation *
      c.world.truth.planes[0].normal_world.cross(c.world.truth.planes[1].normal_world).normalized();
  const Vector6d error = minus(result.T_camera_world, c.truth);
  const Eigen::Vector3d t = error.tail<3>();
  EXPECT_LT((t - along * along.dot(t)).norm(), 2e-3);
}

TEST(PoseOptimiser, WithoutObservationsItIsTheStart) {
  const PoseCase c({.points = 0, .planes = 0});
  Random random(8);
  const Rigid3d start = test::any_pose(random);
  const auto result = c.solve(start);
  EXPECT_LT(minus(result.T_camera_world, start).norm(), 1e-12);
  EXPECT_EQ(result.observed_directions, 0);
  EXPECT_EQ(result.degrees_of_freedom, 0);
}

TEST(PoseOptimiser, OnePointMovesAsLittleAsItMust) {
  PoseCase c({.points = 40, .planes = 0, .depth_share = 1.0});
  c.world.truth.point_observations.resize(1);
  Random random(9);
  const Rigid3d start = plus(c.truth, test::gauss6(random, 0.01, 0.01));
  const auto result = c.solve(start);
  EXPECT_EQ(result.observed_directions, 3);
  EXPECT_LT(result.chi_squared, 1e-6);
  EXPECT_LT(minus(result.T_camera_world, start).norm(), 0.1);
}

TEST(PoseOptimiser, APriorCountsAsMuchAsItsInformation) {
  // With no observations the prior is the answer; with a point-free floor it fills the rest.
  PoseCase c({.points = 0, .planes = 1, .sigma_tilt_rad = 1e-4, .sigma_distance_m = 1e-4});
  Random random(10);
  const PosePrior prior{plus(c.truth, test::gauss6(random, 0.02, 0.02)),
                        1e4 * Matrix6d::Identity()};
  const auto result = c.solve(plus(c.truth, test::gauss6(random, 0.1, 0.2)), {}, prior);
  EXPECT_EQ(result.observed_directions, 6);
  EXPECT_LT(minus(result.T_camera_world, prior.T_camera_world).norm(), 0.1);
  const Eigen::Vector3d normal = c.world.truth.planes[0].normal_world;
  EXPECT_LT((result.T_camera_world.rotation * normal - c.truth.rotation * normal).norm(), 1e-3);
  c.world.truth.plane_observations.clear();
  const auto alone = c.solve(c.truth, {}, prior);
  EXPECT_LT(minus(alone.T_camera_world, prior.T_camera_world).norm(), 1e-9);
}

TEST(PoseOptimiser, PointsBehindTheCameraAreOutliers) {
  PoseCase c({.points = 100, .planes = 0});
  c.points.push_back(c.truth.inverse() * Eigen::Vector3d(0.1, 0.1, -2.0));
  PointObservation seen;
  seen.point = static_cast<int>(c.points.size()) - 1;
  seen.pixel = c.world.camera.project({0.1, 0.1, -2.0});
  c.world.truth.point_observations.push_back(seen);
  const auto result = c.solve(c.truth);
  EXPECT_EQ(result.point_inlier.back(), 0);
  EXPECT_LT(minus(result.T_camera_world, c.truth).norm(), 0.02);
}

TEST(PoseOptimiser, TwoRunsGiveTheSameBits) {
  const PoseCase c({.points = 200});
  Random random(11);
  const Rigid3d start = plus(c.truth, test::gauss6(random, 0.05, 0.1));
  const auto a = c.solve(start);
  const auto b = c.solve(start);
  EXPECT_EQ(std::memcmp(a.T_camera_world.rotation.coeffs().data(),
                        b.T_camera_world.rotation.coeffs().data(), 4 * sizeof(double)),
            0);
  EXPECT_EQ(a.T_camera_world.translation, b.T_camera_world.translation);
  EXPECT_EQ(a.point_inlier, b.point_inlier);
  EXPECT_EQ(a.information, b.information);
}

TEST(PoseOptimiser, WhatCannotBeIsRefused) {
  const PoseCase good({.points = 20});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refuses = [&](const auto& spoil) {
    PoseCase c = good;
    Rigid3d start = c.truth;
    spoil(c, start);
    EXPECT_THROW(c.solve(start), Error);
  };
  EXPECT_NO_THROW(good.solve(good.truth));
  refuses([&](PoseCase&, Rigid3d& start) { start.translation.x() = nan; });
  refuses([&](PoseCase&, Rigid3d& start) { start.rotation.coeffs().setZero(); });
  refuses([&](PoseCase& c, Rigid3d&) { c.points[3].y() = nan; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.planes[0].normal_world *= 2.0; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.point_observations[0].pixel.x() = nan; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.point_observations[0].point = 20; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.point_observations[0].point = -1; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.point_observations[0].sigma_px = 0.0; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.point_observations[0].depth_m = nan; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.plane_observations[0].distance_m = nan; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.truth.plane_observations[0].plane = 4; });
  refuses(
      [&](PoseCase& c, Rigid3d&) { c.world.truth.plane_observations[0].covariance(0, 0) = -1.0; });
  refuses([&](PoseCase& c, Rigid3d&) { c.world.camera.fx = nan; });
}

}  // namespace
}  // namespace weft::slam
