#include "slam/plane_matching.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "slam/plane_gate.hpp"
#include "tests/lib/slam/synthetic_world.hpp"

namespace weft::slam {
namespace {

using test::any_pose;

/// A segment as a camera sees a plane of the world: a square of points about a place on it.
plane::PlaneSegment segment_of(const PlaneState& plane, const Rigid3d& T_camera_world,
                               const Eigen::Vector3d& about_world, double sigma_rad = 0.005,
                               double sigma_m = 0.005) {
  plane::PlaneSegment out;
  out.plane = in_camera(plane, T_camera_world);
  const auto [e0, e1] = plane::tangent_basis(out.plane.normal);
  const Eigen::Vector3d about = T_camera_world * about_world;
  const Eigen::Vector3d on_it = about - out.plane.height_m(about) * out.plane.normal;
  for (double x = -0.3; x < 0.31; x += 0.1)
    for (double y = -0.3; y < 0.31; y += 0.1)
      out.points_camera.push_back((on_it + x * e0 + y * e1).cast<float>());
  out.cells = static_cast<int>(out.points_camera.size());
  out.covariance.diagonal() << sigma_rad * sigma_rad, sigma_rad * sigma_rad, sigma_m * sigma_m;
  return out;
}

const Rigid3d kCamera{exp_rotation({0.1, -0.2, 0.05}), {0.1, 0.2, 3.0}};
const Matrix6d kSure = 1e-8 * Matrix6d::Identity();

PlaneState facing(const Eigen::Vector3d& normal, double distance_m) {
  return {normal.normalized(), distance_m, false};
}

TEST(MatchPlanes, FindsEachAmongOthers) {
  // The far, left, right walls and the floor of a room seen from z = -3.
  const std::vector<PlaneState> states = {facing({0, 0, -1}, -1.5), facing({1, 0, 0}, -1.5),
                                          facing({-1, 0, 0}, -1.5), facing({0, -1, 0}, -1.0),
                                          facing({0, -1, 0}, -0.3)};
  std::vector<KnownPlane> known;
  for (const auto& state : states) known.push_back({state, Eigen::Matrix3d::Zero()});
  std::vector<plane::PlaneSegment> seen;
  for (const int k : {3, 0, 2})
    seen.push_back(segment_of(states[static_cast<std::size_t>(k)], kCamera, {0, 0, 0}));
  EXPECT_EQ(match_planes(seen, known, kCamera, kSure, {}), (std::vector<int>{3, 0, 2}));
  EXPECT_TRUE(match_planes({}, known, kCamera, kSure, {}).empty());
  EXPECT_EQ(match_planes(seen, {}, kCamera, kSure, {}), (std::vector<int>{-1, -1, -1}));
}

// A garment folded to 4 cm on a table passes 30 degrees and 0.1 m.
TEST(MatchPlanes, KeepsAFoldedGarmentOffItsTable) {
  const PlaneState table = facing({0, -1, 0}, -0.8), garment = facing({0.03, -1, 0.02}, -0.76);
  Eigen::Matrix3d covariance = Eigen::Vector3d(1e-6, 1e-6, 1e-6).asDiagonal();
  const auto seen = segment_of(garment, kCamera, {0, 0.76, 0});
  const std::vector<KnownPlane> known = {{table, covariance}};
  PlaneMatchOptions options;
  options.max_chi_squared = 1e6;
  EXPECT_EQ(match_planes({&seen, 1}, known, kCamera, kSure, options)[0], 0);
  EXPECT_EQ(match_planes({&seen, 1}, known, kCamera, kSure, {})[0], -1);
  // Both seen: each is itself, whatever the order, even when the camera's pose is not well known.
  const Matrix6d unsure = 1e-3 * Matrix6d::Identity();
  const std::vector<KnownPlane> both = {{garment, covariance}, {table, covariance}};
  const std::vector<plane::PlaneSegment> seen_both = {segment_of(table, kCamera, {0, 0.8, 0}),
                                                      seen};
  EXPECT_EQ(match_planes(seen_both, both, kCamera, unsure, {}), (std::vector<int>{1, 0}));
}

TEST(MatchPlanes, HasThreeGates) {
  const PlaneState wall = facing({0, 0, -1}, -1.5);
  const std::vector<KnownPlane> known = {{wall, 10.0 * Eigen::Matrix3d::Identity()}};
  const auto try_one = [&](const PlaneState& seen, const Eigen::Vector3d& about) {
    const auto segment = segment_of(seen, kCamera, about);
    return match_planes({&segment, 1}, known, kCamera, kSure, {})[0];
  };
  const auto tilted = [](double angle_deg) {
    const double a = angle_deg * std::numbers::pi / 180.0;
    const Eigen::Vector3d n(std::sin(a), 0.0, -std::cos(a));
    return facing(n, n.dot(Eigen::Vector3d(0, 0, 1.5)));  // turned about (0, y, 1.5)
  };
  EXPECT_EQ(try_one(tilted(20.0), {0, 0, 1.5}), 0);
  EXPECT_EQ(try_one(tilted(32.0), {0, 0, 1.5}), -1);
  EXPECT_EQ(try_one(facing({0, 0, -1}, -1.42), {0, 0, 1.5}), 0);
  EXPECT_EQ(try_one(facing({0, 0, -1}, -1.38), {0, 0, 1.5}), -1);
}

TEST(MatchPlanes, TakesNoOtherSideForThePlane) {
  // A board 2 cm thin seen from either side.
  const std::vector<KnownPlane> known = {{facing({0, 0, -1}, -1.5), Eigen::Matrix3d::Zero()}};
  const Rigid3d behind{exp_rotation({0, std::numbers::pi, 0}), {0, 0, 4.5}};
  const auto seen = segment_of(facing({0, 0, 1}, 1.5), behind, {0, 0, 1.5});
  EXPECT_EQ(match_planes({&seen, 1}, known, behind, kSure, {})[0], -1);
}

TEST(MatchPlanes, IsOneToOne) {
  const PlaneState wall = facing({0, 0, -1}, -1.5);
  const std::vector<KnownPlane> known = {{wall, Eigen::Matrix3d::Zero()}};
  const std::vector<plane::PlaneSegment> seen = {
      segment_of(facing({0, 0.01, -1}, -1.5), kCamera, {0, 0, 1.5}),
      segment_of(wall, kCamera, {0.5, 0, 1.5})};
  EXPECT_EQ(match_planes(seen, known, kCamera, kSure, {}), (std::vector<int>{-1, 0}));
}

TEST(MatchPlanes, RefusesWhatCannotBe) {
  const std::vector<KnownPlane> known = {{facing({0, 0, -1}, -1.5), Eigen::Matrix3d::Zero()}};
  auto seen = segment_of(known[0].state, kCamera, {0, 0, 1.5});
  seen.covariance(0, 0) = -1.0;
  EXPECT_THROW(match_planes({&seen, 1}, known, kCamera, kSure, {}), Error);
  PlaneMatchOptions options;
  options.max_angle_deg = 100.0;
  EXPECT_THROW(match_planes({}, known, kCamera, kSure, options), Error);
}

}  // namespace
}  // namespace weft::slam
