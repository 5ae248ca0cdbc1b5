#include "slam/pose_graph.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "base/error.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

constexpr int kCameras = 40;

/// A ring of cameras with noisy odometry and one exact loop edge; starts chained from odometry.
struct Ring {
  std::vector<Rigid3d> truth;
  std::vector<CameraState> cameras;
  std::vector<RelativePose> edges;
  explicit Ring(double sigma_rad, double sigma_m, int seed) {
    Random random(static_cast<std::uint64_t>(seed));
    Matrix6d information = Matrix6d::Identity();
    information.diagonal().head<3>().setConstant(1.0 / (sigma_rad * sigma_rad));
    information.diagonal().tail<3>().setConstant(1.0 / (sigma_m * sigma_m));
    for (int i = 0; i < kCameras; ++i) {
      const double turn = 2.0 * std::numbers::pi * i / kCameras;
      const Rigid3d T_world_camera{
          exp_rotation({0, turn, 0}),
          {3.0 * std::sin(turn), 0.2 * std::sin(3 * turn), 3.0 * std::cos(turn)}};
      truth.push_back(T_world_camera.inverse());
    }
    cameras.push_back({truth[0], true});
    const auto at = [](int i) { return static_cast<std::size_t>(i); };
    for (int i = 1; i < kCameras; ++i) {
      const Rigid3d T_a_b = truth[at(i - 1)] * truth[at(i)].inverse() *
                            plus({}, test::gauss6(random, sigma_rad, sigma_m));
      edges.push_back({i - 1, i, T_a_b, information});
      cameras.push_back({T_a_b.inverse() * cameras.back().T_camera_world, false});
    }
    edges.push_back({kCameras - 1, 0, truth.back() * truth.front().inverse(), 100.0 * information});
  }
  double worst(const std::vector<CameraState>& solved) const {
    double out = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      out = std::max(
          out,
          (solved[i].T_camera_world.inverse().translation - truth[i].inverse().translation).norm());
    }
    return out;
  }
};

TEST(PoseGraph, ALoopSpreadsTheDrift) {
  double before = 0.0, after = 0.0, chi_squared = 0.0;
  for (int seed = 1; seed <= 10; ++seed) {
    Ring ring(0.01, 0.01, seed);
    before += ring.worst(ring.cameras);
    const auto result = optimise_pose_graph(ring.cameras, ring.edges);
    after += ring.worst(ring.cameras);
    EXPECT_LT(result.final_cost, result.initial_cost);
    EXPECT_TRUE(result.converged);
    ASSERT_EQ(result.chi_squared.size(), ring.edges.size());
    double sum = 0.0;
    for (const double value : result.chi_squared) sum += value;
    EXPECT_NEAR(0.5 * sum, result.final_cost, 1e-6 * (1.0 + sum));
    chi_squared += sum;
  }
  EXPECT_LT(after, 0.6 * before);
  // Forty edges for thirty-nine poses: six degrees of freedom a ring.
  EXPECT_TRUE(test::is_plausible_chi_squared(chi_squared, 60)) << chi_squared;
}

TEST(PoseGraph, ExactEdgesGiveTheExactAnswerAndTheSameBits) {
  const Ring exact(1e-9, 1e-9, 3);
  Random random(4);
  auto start = exact.cameras;
  for (auto& camera : start) {
    if (!camera.fixed)
      camera.T_camera_world = plus(camera.T_camera_world, test::gauss6(random, 0.1, 0.2));
  }
  auto edges = exact.edges;
  for (auto& edge : edges) edge.information = Matrix6d::Identity();
  auto a = start, b = start;
  optimise_pose_graph(a, edges, {.iterations = 50});
  optimise_pose_graph(b, edges, {.iterations = 50});
  EXPECT_LT(exact.worst(a), 1e-5);
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].T_camera_world.rotation.coeffs(), b[i].T_camera_world.rotation.coeffs());
    EXPECT_EQ(a[i].T_camera_world.translation, b[i].T_camera_world.translation);
  }
}

TEST(PoseGraph, AKernelStandsAFalseLoop) {
  Ring plain(0.005, 0.005, 5);
  plain.edges.push_back({5, 25, {}, plain.edges[0].information});
  Ring robust = plain;
  optimise_pose_graph(plain.cameras, plain.edges);
  const auto result =
      optimise_pose_graph(robust.cameras, robust.edges, {.iterations = 100, .huber = 3.5});
  EXPECT_LT(robust.worst(robust.cameras), 0.5 * plain.worst(plain.cameras));
  EXPECT_EQ(std::max_element(result.chi_squared.begin(), result.chi_squared.end()) -
                result.chi_squared.begin(),
            kCameras);
}

TEST(PoseGraph, WhatCannotBeIsRefused) {
  const Ring ring(0.01, 0.01, 1);
  const auto refuses = [&](const auto& spoil) {
    Ring copy = ring;
    spoil(copy);
    EXPECT_THROW(optimise_pose_graph(copy.cameras, copy.edges), Error);
  };
  refuses([](Ring& r) { r.cameras[0].fixed = false; });
  refuses([](Ring& r) { r.edges[3].camera_a = kCameras; });
  refuses([](Ring& r) { r.edges[3].camera_b = -1; });
  refuses([](Ring& r) { r.edges[3].camera_b = r.edges[3].camera_a; });
  refuses([](Ring& r) { r.edges[3].T_a_b.translation.x() = std::nan(""); });
  refuses([](Ring& r) { r.edges[3].information.setZero(); });
  refuses([](Ring& r) { r.cameras[2].T_camera_world.rotation.coeffs().setZero(); });
}

}  // namespace
}  // namespace weft::slam
