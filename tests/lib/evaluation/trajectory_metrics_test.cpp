#include "evaluation/trajectory_metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "support/files.hpp"

namespace weft::evaluation {
namespace {

using dataset::StampedPose;
using dataset::Trajectory;
using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Alignment = TrajectoryOptions::Alignment;

constexpr double kDeg = std::numbers::pi / 180.0;

StampedPose at(double seconds, const Vector3d& position = Vector3d::Zero(),
               const Quaterniond& rotation = Quaterniond::Identity()) {
  return {std::llround(seconds * 1e6), rotation, position};
}

Quaterniond about_z(double degrees) {
  return Quaterniond(Eigen::AngleAxisd(degrees * kDeg, Vector3d::UnitZ()));
}

Trajectory moved(const Trajectory& trajectory, const Isometry3d& by) {
  Trajectory result;
  for (const auto& pose : trajectory) {
    const Isometry3d T = by * pose.T_world_camera();
    result.push_back({pose.utime, Quaterniond(T.linear()), T.translation()});
  }
  return result;
}

Trajectory wild_path(int count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Trajectory result;
  for (int i = 0; i < count; ++i) {
    result.push_back(at(
        0.1 * i, {normal(random), normal(random), normal(random)},
        Quaterniond(normal(random), normal(random), normal(random), normal(random)).normalized()));
  }
  return result;
}

Isometry3d some_motion() {
  return Eigen::Translation3d(3.0, -2.0, 0.5) *
         Eigen::AngleAxisd(2.1, Vector3d(1, -2, 0.4).normalized());
}

// Four corners of a 2 x 2 square, each seen 3 cm further out along the diagonal: the centre and the
// axes stay, so no rigid motion does better, and every error is 3 cm.
TEST(Trajectory, AteOfABlownUpSquareIsTheBlowUp) {
  Trajectory truth, estimate;
  const Vector3d corners[] = {{1, 1, 0}, {-1, 1, 0}, {-1, -1, 0}, {1, -1, 0}};
  for (int i = 0; i < 4; ++i) {
    truth.push_back(at(i, corners[i]));
    estimate.push_back(at(i, corners[i] + 0.03 * corners[i].normalized()));
  }
  const auto e = evaluate_trajectory(moved(estimate, some_motion()), truth, {});
  EXPECT_EQ(e.poses, 4u);
  for (const double value : {e.ate_m.rmse, e.ate_m.mean, e.ate_m.median, e.ate_m.max})
    EXPECT_NEAR(value, 0.03, 1e-12);
  EXPECT_NEAR(e.rotation_deg.max, 0.0, 1e-6);
  EXPECT_LT((e.T_truth_estimate.matrix() - some_motion().inverse().matrix()).norm(), 1e-12);
}

// One of five poses on the x axis is 10 cm off in y; without alignment the errors are 0, 0, 0.1, 0,
// 0: rmse 0.1 / sqrt(5), mean 0.02, median 0, max 0.1. Of the four relative poses two are wrong by
// 0.1: rmse sqrt(2 * 0.01 / 4).
TEST(Trajectory, OneOutlierByHand) {
  Trajectory truth, estimate;
  for (int i = 0; i < 5; ++i) {
    truth.push_back(at(i, {0.5 * i, 0, 0}));
    estimate.push_back(at(i, {0.5 * i, i == 2 ? 0.1 : 0.0, 0}));
  }
  TrajectoryOptions options;
  options.alignment = Alignment::kNone;
  options.segment_lengths_m = {1.0};
  const auto e = evaluate_trajectory(estimate, truth, options);
  EXPECT_NEAR(e.ate_m.rmse, 0.1 / std::sqrt(5.0), 1e-12);
  EXPECT_NEAR(e.ate_m.mean, 0.02, 1e-12);
  EXPECT_NEAR(e.ate_m.median, 0.0, 1e-12);
  EXPECT_NEAR(e.ate_m.max, 0.1, 1e-12);
  EXPECT_EQ(e.rpe_translation_m.count, 4);
  EXPECT_NEAR(e.rpe_translation_m.rmse, std::sqrt(0.005), 1e-12);
  EXPECT_NEAR(e.rpe_translation_m.median, 0.05, 1e-12);
  // 10 pairs, of which the four with pose 2 are wrong by 0.1.
  EXPECT_EQ(e.pair_translation_m.count, 10);
  EXPECT_NEAR(e.pair_translation_m.mean, 0.04, 1e-12);
  // Segments of 1 m begin at poses 0, 1, 2: errors 10 %, 0 %, 10 %.
  ASSERT_EQ(e.segments.size(), 1u);
  EXPECT_EQ(e.segments[0].count, 3);
  EXPECT_NEAR(e.segments[0].translation_percent, 20.0 / 3.0, 1e-10);
  options.rpe_step = 2;  // (0,2), (1,3), (2,4)
  EXPECT_NEAR(evaluate_trajectory(estimate, truth, options).rpe_translation_m.rmse,
              std::sqrt(0.02 / 3.0), 1e-12);
  options.rpe_step = 5;
  EXPECT_EQ(evaluate_trajectory(estimate, truth, options).rpe_translation_m.count, 0);
}

// A camera that steps 1 m forward along its own x, believed to turn by 3 deg at every step.
TEST(Trajectory, RelativeRotationByHand) {
  Trajectory truth, estimate;
  Isometry3d T = Isometry3d::Identity();
  for (int i = 0; i < 6; ++i) {
    truth.push_back(at(i, {1.0 * i, 0, 0}));
    estimate.push_back(at(i, T.translation(), Quaterniond(T.linear())));
    T = T * Eigen::Translation3d(1, 0, 0) * about_z(3.0);
  }
  TrajectoryOptions options;
  options.alignment = Alignment::kFirst;
  options.segment_lengths_m = {1.0, 2.0, 100.0};
  const auto e = evaluate_trajectory(moved(estimate, some_motion()), truth, options);
  EXPECT_NEAR(e.rpe_rotation_deg.rmse, 3.0, 1e-9);
  EXPECT_NEAR(e.rpe_translation_m.rmse, 0.0, 1e-9);
  EXPECT_NEAR(e.rotation_deg.max, 15.0, 1e-9);
  EXPECT_NEAR(e.pair_rotation_deg.max, 15.0, 1e-9);
  ASSERT_EQ(e.segments.size(), 2u);  // 100 m are never reached
  EXPECT_EQ(e.segments[0].count, 5);
  EXPECT_NEAR(e.segments[0].rotation_deg_per_m, 3.0, 1e-9);
  EXPECT_EQ(e.segments[1].count, 4);
  EXPECT_NEAR(e.segments[1].rotation_deg_per_m, 3.0, 1e-9);
  // After two steps: (1 + cos 3, sin 3) against (2, 0), over 2 m.
  const double off = std::hypot(1.0 - std::cos(3.0 * kDeg), std::sin(3.0 * kDeg));
  EXPECT_NEAR(e.segments[1].translation_percent, 100.0 * off / 2.0, 1e-9);
  EXPECT_EQ(e.all_segments.count, 9);
  EXPECT_NEAR(e.all_segments.translation_percent, 4.0 * 100.0 * off / 2.0 / 9.0, 1e-9);
}

// Alignment must not matter to relative errors, and the aligned error must not depend on the frame
// the estimate came in.
TEST(Trajectory, FramesOfReferenceDoNotMatter) {
  const Trajectory truth = wild_path(40, 1);
  Trajectory estimate = wild_path(40, 2);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    estimate[i].camera_in_world = truth[i].camera_in_world + 0.05 * estimate[i].camera_in_world;
    estimate[i].rotation_world_camera =
        truth[i].rotation_world_camera.slerp(0.05, estimate[i].rotation_world_camera);
  }
  const auto a = evaluate_trajectory(estimate, truth, {});
  const auto b = evaluate_trajectory(moved(estimate, some_motion()), truth, {});
  EXPECT_NEAR(a.ate_m.rmse, b.ate_m.rmse, 1e-12);
  EXPECT_NEAR(a.rotation_deg.rmse, b.rotation_deg.rmse, 1e-9);
  EXPECT_NEAR(a.rpe_translation_m.rmse, b.rpe_translation_m.rmse, 1e-12);
  EXPECT_NEAR(a.all_segments.translation_percent, b.all_segments.translation_percent, 1e-9);
  // The aligned error is a minimum: no small motion makes it smaller.
  TrajectoryOptions fixed;
  fixed.alignment = Alignment::kNone;
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0.0, 0.003);
  for (int trial = 0; trial < 50; ++trial) {
    const Vector3d turn(normal(random), normal(random), normal(random));
    const Isometry3d nudge = Eigen::Translation3d(normal(random), normal(random), normal(random)) *
                             Eigen::AngleAxisd(turn.norm(), turn.normalized());
    EXPECT_GT(
        evaluate_trajectory(moved(estimate, nudge * a.T_truth_estimate), truth, fixed).ate_m.rmse,
        a.ate_m.rmse);
  }
}

// A reflection would fit better; a camera path must not be mirrored.
TEST(Trajectory, AlignmentNeverMirrors) {
  const Trajectory truth = wild_path(20, 4);
  Trajectory estimate = truth;
  for (auto& pose : estimate) pose.camera_in_world.x() *= -1.0;
  const auto e = evaluate_trajectory(estimate, truth, {});
  EXPECT_NEAR(e.T_truth_estimate.linear().determinant(), 1.0, 1e-12);
  EXPECT_GT(e.ate_m.rmse, 0.3);
}

TEST(Trajectory, OneOrTwoPosesFit) {
  const Trajectory truth{at(0, {1, 2, 3}), at(1, {2, 2, 3})};
  const auto two = evaluate_trajectory(moved(truth, some_motion()), truth, {});
  EXPECT_NEAR(two.ate_m.rmse, 0.0, 1e-12);
  const auto one = evaluate_trajectory({at(1, {7, 7, 7})}, truth, {});
  EXPECT_NEAR(one.ate_m.rmse, 0.0, 1e-12);
  EXPECT_EQ(one.rpe_translation_m.count, 0);
  EXPECT_EQ(one.pair_translation_m.count, 0);
  EXPECT_TRUE(one.segments.empty());
}

TEST(Trajectory, PosesAreAssociatedByTimeEachOnce) {
  // 1.00 and 1.01 compete for the truth at 1.008: 1.01 is closer; 1.00 is left with 0.99.
  const Trajectory estimate{at(0.0), at(1.0), at(1.01), at(5.0)};
  const Trajectory truth{at(0.99), at(1.008), at(4.97), at(9.0)};
  EXPECT_EQ(associate(estimate, truth, 20'000), (std::vector<Association>{{1, 0}, {2, 1}}));
  EXPECT_EQ(associate(estimate, truth, 30'000), (std::vector<Association>{{1, 0}, {2, 1}, {3, 2}}));
  EXPECT_TRUE(associate(estimate, truth, 1'000).empty());
  const std::string error =
      test::error_of([&] { evaluate_trajectory(estimate, {at(100.0)}, TrajectoryOptions{}); });
  EXPECT_NE(error.find("4 poses from 0.000000 to 5.000000"), std::string::npos) << error;
  EXPECT_NE(error.find("1 poses from 100.000000"), std::string::npos) << error;
}

// Against all pairs, sorted: the rule of the benchmark's own associate.py.
TEST(Trajectory, AssociationEqualsTheBruteForceOne) {
  std::mt19937_64 random(9);
  for (int trial = 0; trial < 50; ++trial) {
    const auto draw = [&] {
      std::vector<std::int64_t> times(20);
      for (auto& t : times) t = static_cast<std::int64_t>(random() % 1000) * 1000;
      std::sort(times.begin(), times.end());
      times.erase(std::unique(times.begin(), times.end()), times.end());
      Trajectory result;
      for (const auto t : times) result.push_back({t, Quaterniond::Identity(), Vector3d::Zero()});
      return result;
    };
    const Trajectory a = draw(), b = draw();
    std::vector<Association> expected;
    for (;;) {
      std::int64_t best = 30'001;
      Association pair;
      for (std::size_t i = 0; i < a.size(); ++i) {
        for (std::size_t j = 0; j < b.size(); ++j) {
          if (std::any_of(expected.begin(), expected.end(),
                          [&](const auto& p) { return p.first == i || p.second == j; }))
            continue;
          const std::int64_t difference = std::abs(a[i].utime - b[j].utime);
          if (difference < best) best = difference, pair = {i, j};
        }
      }
      if (best > 30'000) break;
      expected.push_back(pair);
    }
    std::sort(expected.begin(), expected.end());
    EXPECT_EQ(associate(a, b, 30'000), expected);
  }
}

TEST(Trajectory, TheKeysOfTheScriptsAreThere) {
  const Trajectory truth = wild_path(5, 7);
  const auto json = to_json(evaluate_trajectory(truth, truth, {}), 9);
  EXPECT_NEAR(json.at("ate_rmse_m").get<double>(), 0.0, 1e-12);
  EXPECT_NEAR(json.at("rpe_trans_m").get<double>(), 0.0, 1e-12);
  EXPECT_NEAR(json.at("rpe_rot_deg").get<double>(), 0.0, 1e-5);
  EXPECT_EQ(json.at("poses"), 5);
  EXPECT_EQ(json.at("frames"), 9);
}

TEST(Trajectory, LongPathsTakeEveryKthPoseForAllPairs) {
  Trajectory truth, estimate;
  for (int i = 0; i < 2500; ++i) {
    truth.push_back(at(i, {0.01 * i, 0, 0}));
    estimate.push_back(at(i, {0.011 * i, 0, 0}));
  }
  const auto e = evaluate_trajectory(estimate, truth, {});
  EXPECT_EQ(e.pair_translation_m.count, 834 * 833 / 2);
  EXPECT_NEAR(e.pair_translation_m.max, 0.001 * 833 * 3, 1e-9);
  EXPECT_NEAR(e.all_segments.translation_percent, 10.0, 0.2);
}

TEST(Trajectory, SettingsAreChecked) {
  TrajectoryOptions options;
  options.segment_lengths_m = {1.0, 0.0};
  EXPECT_NE(test::error_of([&] { options.validate(); }).find("above 0"), std::string::npos);
}

}  // namespace
}  // namespace weft::evaluation
