#include "slam/map_planes.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "mapping_world.hpp"
#include "slam/map_adjustment.hpp"

namespace weft::slam {
namespace {

using test::MappingWorld;
using test::standing_at;

/// Inserts what a camera sees, with its true pose.
Id insert_frame(MapEditor& editor, const test::SeenFrame& seen) {
  KeyFrame key_frame;
  key_frame.frame = seen.input.frame;
  key_frame.camera = seen.input.camera;
  key_frame.T_camera_world = seen.T_camera_world;
  key_frame.features = seen.input.features;
  for (const auto& segment : seen.input.planes) key_frame.planes.push_back({segment, kNoId});
  const Id id = editor.add_key_frame(std::move(key_frame));
  if (id > 0) editor.set_parent(id, id - 1);
  return id;
}

/// Which planes of the map each rectangle was taken for.
std::map<int, std::set<Id>> planes_of(const Map& map, const std::vector<test::SeenFrame>& seen) {
  std::map<int, std::set<Id>> out;
  for (const auto& [id, key_frame] : map.key_frames)
    for (std::size_t s = 0; s < key_frame.planes.size(); ++s)
      out[seen[static_cast<std::size_t>(id)].rectangles[s]].insert(key_frame.planes[s].plane);
  return out;
}

Matrix6d tracked_well() { return 1e-5 * Matrix6d::Identity(); }  // 3 mm, 0.2 degrees

/// A table seen from above at 1.2 m, and cloth on it that comes into view later. Returns the planes
/// of the map that table and cloth were taken for, and their distances.
struct TableAndCloth {
  std::set<Id> table, cloth;
  double table_m = 0.0, cloth_m = 0.0;
};
TableAndCloth look_at_cloth(double thickness_m, const PlaneMappingOptions& options) {
  MappingWorld world(31);
  world.rectangles.push_back({{-0.8, -0.5, 1.2}, {0, 1.2, 0}, {1.6, 0, 0}});
  world.rectangles.push_back({{-0.1, -0.1, 1.2 - thickness_m}, {0, 0.32, 0}, {0.32, 0, 0}});
  world.distance_m = 0.002;
  MapEditor editor;
  const PlaneMapper planes(options);
  std::vector<test::SeenFrame> seen;
  for (int k = 0; k < 12; ++k) {
    seen.push_back(world.see(k, k * 33333, standing_at({-1.2 + 0.12 * k, 0, 0}, 0.0)));
    const Id id = insert_frame(editor, seen.back());
    planes.associate(editor, id, tracked_well());
    planes.judge(editor, id, {}, 0.5);
    for (const auto& sighting : editor.key_frame(id).planes)
      planes.estimate(editor, sighting.plane);
    planes.merge(editor);
    EXPECT_EQ(test::inconsistency(editor.map()), "");
  }
  const auto of = planes_of(editor.map(), seen);
  return {of.at(0), of.at(1), editor.plane(*of.at(0).begin()).distance_m,
          editor.plane(*of.at(1).begin()).distance_m};
}

TEST(MapPlanes, AFoldedGarmentIsNotTheTableItLiesOn) {
  for (const double thickness : {0.03, 0.05}) {
    const auto seen = look_at_cloth(thickness, {});
    ASSERT_EQ(seen.table.size(), 1u) << thickness;
    ASSERT_EQ(seen.cloth.size(), 1u) << thickness;
    EXPECT_NE(seen.table, seen.cloth) << thickness;
    EXPECT_NEAR(seen.table_m, -1.2, 0.003);
    EXPECT_NEAR(seen.cloth_m, -1.2 + thickness, 0.003);
  }
  // With the paper's 30 degrees and 0.1 m alone it is.
  PlaneMappingOptions paper;
  paper.match.max_chi_squared = 1e6;
  paper.same_frame_tilt_deg = 10.0;
  paper.same_frame_distance_m = 0.1;
  const auto seen = look_at_cloth(0.05, paper);
  EXPECT_EQ(seen.table, seen.cloth);
}

TEST(MapPlanes, PiecesOfAWallBecomeOneWhenTheMiddleIsSeen) {
  MappingWorld world(32);
  world.rectangles.push_back({{-2.0, -1, 2.0}, {0, 2, 0}, {1, 0, 0}});
  world.rectangles.push_back({{1.0, -1, 2.0}, {0, 2, 0}, {1, 0, 0}});
  MapEditor editor;
  const PlaneMapper planes({});
  std::vector<test::SeenFrame> seen;
  const auto look = [&](const Rigid3d& T) {
    seen.push_back(world.see(static_cast<std::int64_t>(seen.size()), 0, T));
    const Id id = insert_frame(editor, seen.back());
    planes.associate(editor, id, tracked_well());
    planes.judge(editor, id, {}, 0.5);
    planes.merge(editor);
  };
  for (int k = 0; k < 3; ++k) look(standing_at({0, 0, -1.0}, 0.0));
  EXPECT_EQ(editor.map().planes.size(), 2u);
  EXPECT_EQ(planes_of(editor.map(), seen).at(0).size(), 1u);
  world.rectangles.push_back({{-1.0, -1, 2.0}, {0, 2, 0}, {2, 0, 0}});
  look(standing_at({0, 0, -1.0}, 0.0));
  EXPECT_EQ(editor.map().planes.size(), 1u);
  EXPECT_EQ(test::inconsistency(editor.map()), "");
  EXPECT_EQ(editor.map().planes.begin()->second.observations.size(), 9u);
  // One point a voxel, all of them on the wall.
  std::set<std::array<int, 3>> voxels;
  for (const auto& point : editor.map().planes.begin()->second.cloud_world) {
    EXPECT_NEAR(point.z(), 2.0, 0.1);
    EXPECT_TRUE(voxels
                    .insert({static_cast<int>(std::floor(point.x() / 0.05)),
                             static_cast<int>(std::floor(point.y() / 0.05)),
                             static_cast<int>(std::floor(point.z() / 0.05))})
                    .second);
  }
}

TEST(MapPlanes, AreBelievedByTimeOrByCount) {
  MappingWorld world(33);
  world.rectangles.push_back({{-1.0, -1, 2.0}, {0, 2, 0}, {2, 0, 0}});
  const auto run = [&](double frame_s, int between, int key_frames) {
    MapEditor editor;
    const PlaneMapper planes({});
    for (int k = 0; k < key_frames; ++k) {
      // Seen in the first two key frames only.
      const auto T = standing_at({0, 0, 0}, k < 2 ? 0.0 : std::numbers::pi);
      const Id id = insert_frame(editor, world.see(k, 0, T));
      planes.associate(editor, id, tracked_well());
      std::vector<Sightings> seen;
      if (k == 1) seen = {{0, between, between}, {55, 3, 3}};
      planes.judge(editor, id, seen, frame_s);
    }
    return editor.map().planes.empty() ? -1 : int{editor.map().planes.at(0).confirmed};
  };
  EXPECT_EQ(run(0.67, 1, 2), 0);          // sparse: seen in two frames
  EXPECT_EQ(run(0.67, 2, 2), 1);          // in three
  EXPECT_EQ(run(1.0 / 30.0, 4, 2), 0);    // 30 Hz: in five
  EXPECT_EQ(run(1.0 / 30.0, 5, 2), 1);    // in six: 0.2 s
  EXPECT_EQ(run(1.0 / 30.0, 4, 10), 0);   // not believed ...
  EXPECT_EQ(run(1.0 / 30.0, 4, 11), -1);  // ... for ten key frames
}

TEST(MapPlanes, TheCovarianceOfAnEstimateIsThatOfItsErrors) {
  MappingWorld world(34);
  world.rectangles.push_back({{-1.0, -1, 2.0}, {0, 2, 0}, {2, 0, 0}});
  PlaneMappingOptions options;
  options.match.noise = test::no_floors();
  const PlaneMapper planes(options);
  const PlaneState truth{{0, 0, -1}, -2.0, false};
  const auto [e0, e1] = plane::tangent_basis(truth.normal_world);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero(), told = Eigen::Matrix3d::Zero();
  constexpr int kDraws = 1500;
  for (int draw = 0; draw < kDraws; ++draw) {
    MapEditor editor;
    const Id plane = editor.add_plane(truth.normal_world, truth.distance_m);
    for (int k = 0; k < 4; ++k) {
      const auto seen = world.see(k, 0, standing_at({0.3 * k, 0.1, 0}, -0.1 * k));
      editor.observe_plane(plane, insert_frame(editor, seen), 0);
    }
    planes.estimate(editor, plane);
    const MapPlane& got = editor.plane(plane);
    const Eigen::Vector3d e(e0.dot(got.normal_world), e1.dot(got.normal_world),
                            got.distance_m - truth.distance_m);
    sum += e * e.transpose() / kDraws;
    told += got.covariance / kDraws;
  }
  EXPECT_LT((sum - told).norm(), 0.1 * told.norm());
}

TEST(MapAdjustment, GivesTheChiSquaredOfTheNoiseThatIsThere) {
  MappingWorld world(35);
  world.add_room({0, 0, 0}, 4.0, 2.6, 150);
  world.features = 150;
  PointMappingOptions point_options;
  point_options.noise.sigma_px = world.sigma_px;
  point_options.noise.inverse_depth_per_m = world.inverse_depth_per_m;
  point_options.noise.depth_floor_m = 1e-5;
  const PointMapper points(point_options);
  AdjustmentOptions options;
  options.bundle.reject = false;
  options.bundle.iterations = 30;
  options.bundle.plane_noise = test::no_floors();
  // Everything is matched truly; poses start off the truth.
  MapEditor editor;
  std::map<int, Id> point_of, plane_of;
  std::set<Id> all;
  for (int k = 0; k < 6; ++k) {
    const auto seen = world.see(k, 0, standing_at({0.15 * k, 0, -0.5}, 0.05 * k));
    const Id id = insert_frame(editor, seen);
    all.insert(id);
    for (std::size_t i = 0; i < seen.landmarks.size(); ++i) {
      const int landmark = seen.landmarks[i];
      const auto& at = world.landmarks[static_cast<std::size_t>(landmark)].position_world;
      if (!point_of.contains(landmark)) point_of[landmark] = editor.add_point(at, id);
      editor.observe_point(point_of[landmark], id, static_cast<int>(i));
    }
    for (std::size_t s = 0; s < seen.rectangles.size(); ++s) {
      const auto& wall = world.rectangles[static_cast<std::size_t>(seen.rectangles[s])];
      if (!plane_of.contains(seen.rectangles[s])) {
        const Id plane = editor.add_plane(wall.normal(), wall.normal().dot(wall.corner));
        editor.edit_plane(plane).confirmed = true;
        plane_of[seen.rectangles[s]] = plane;
      }
      editor.observe_plane(plane_of[seen.rectangles[s]], id, static_cast<int>(s));
    }
    if (k > 0)
      editor.set_pose(id, plus(seen.T_camera_world, test::gauss6(world.random(), 0.01, 0.02)));
  }
  const auto report = adjust(editor, points, point_options.noise, all, 1000000, options);
  EXPECT_EQ(report.key_frames, 6);
  EXPECT_EQ(report.fixed_key_frames, 0);
  EXPECT_GT(report.points, 100);
  EXPECT_GE(report.planes, 2);
  EXPECT_TRUE(test::is_plausible_chi_squared(report.chi_squared, report.degrees_of_freedom))
      << report.chi_squared << " of " << report.degrees_of_freedom;
  // The planes came out where they are, by their own covariances.
  for (const auto& [rectangle, id] : plane_of) {
    const auto& wall = world.rectangles[static_cast<std::size_t>(rectangle)];
    const MapPlane& got = editor.plane(id);
    const auto [e0, e1] = plane::tangent_basis(got.normal_world);
    const Eigen::Vector3d e(e0.dot(wall.normal()), e1.dot(wall.normal()),
                            wall.normal().dot(wall.corner) - got.distance_m);
    ASSERT_GT(got.covariance(0, 0), 0.0);
    EXPECT_LT(e.dot(got.covariance.llt().solve(e)), 21.1);  // 99.99 %
  }
}

}  // namespace
}  // namespace weft::slam
