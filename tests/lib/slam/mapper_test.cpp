#include "slam/mapper.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "base/error.hpp"
#include "mapping_world.hpp"

namespace weft::slam {
namespace {

using test::MappingWorld;
using test::standing_at;
using test::TruthfulTracker;

/// Along the middle of a room, turning a little.
Rigid3d along(int step) {
  return standing_at({-1.0 + 0.1 * step, 0.02 * step, -0.8}, 0.3 - 0.03 * step);
}

TEST(Mapper, AFirstKeyFrameStartsTheMap) {
  MappingWorld world(1);
  world.add_room({0, 0, 0}, 4.0, 2.6, 400);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  const NewKeyFrame first = tracker.next(along(0));
  const MapUpdate update = mapper.add(first);
  EXPECT_EQ(update.from_version, 0);
  EXPECT_EQ(update.to_version, 1);
  EXPECT_EQ(update.frame, 0);
  const Map& map = mapper.map();
  ASSERT_EQ(map.key_frames.size(), 1u);
  EXPECT_EQ(map.planes.size(), first.input.planes.size());
  EXPECT_TRUE(map.key_frames.at(0).keep);
  EXPECT_GT(map.points.size(), 100u);
  // All close features with depth have become points, where they are.
  for (std::size_t i = 0; i < first.input.features.size(); ++i) {
    const Feature& feature = first.input.features[i];
    const Id id = map.key_frames.at(0).points[i];
    ASSERT_EQ(id != kNoId, feature.depth_m > 0.0f && feature.depth_m < 3.1f) << i;
    if (id == kNoId) continue;
    const Eigen::Vector3d expected =
        world.camera.unproject(feature.u_px, feature.v_px, feature.depth_m);
    EXPECT_LT((map.points.at(id).position_world - expected).norm(), 1e-12);
  }
  EXPECT_EQ(test::inconsistency(map), "");
}

TEST(Mapper, FarFeaturesBecomePointsWhereFewAreClose) {
  MappingWorld world(2);
  world.add_wall({{-6, -4, 6}, {0, 8, 0}, {12, 0, 0}}, 1200);  // 6 m away: none is close
  MapperOptions options;
  options.use_planes = false;
  Mapper mapper(options, nullptr);
  TruthfulTracker tracker(world, mapper);
  const NewKeyFrame first = tracker.next(standing_at({0, 0, 0}, 0.0));
  ASSERT_GT(first.input.features.size(), 150u);
  mapper.add(first);
  EXPECT_EQ(mapper.map().points.size(), 100u);
  // The nearest: no feature left out is nearer than one taken.
  float farthest_taken = 0.0f, nearest_left = std::numeric_limits<float>::infinity();
  for (std::size_t i = 0; i < first.input.features.size(); ++i) {
    const float depth = first.input.features[i].depth_m;
    if (mapper.map().key_frames.at(0).points[i] != kNoId)
      farthest_taken = std::max(farthest_taken, depth);
    else
      nearest_left = std::min(nearest_left, depth);
  }
  EXPECT_LE(farthest_taken, nearest_left);
}

TEST(Mapper, MapsARoom) {
  MappingWorld world(3);
  world.add_room({0, 0, 0}, 5.0, 2.6, 400);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  tracker.sigma_m = 0.01;  // the mapper refines what the tracker says
  tracker.sigma_rad = 0.004;
  Map copy;
  for (int step = 0; step < 20; ++step) {
    apply(tracker.step(along(step)), copy);
    ASSERT_EQ(test::inconsistency(mapper.map()), "") << step;
    ASSERT_TRUE(test::same(copy, mapper.map())) << step;
  }
  EXPECT_LT(tracker.worst_m(), 0.01);
  // Every landmark is one point, but for a few.
  std::map<int, std::set<Id>> points_of;
  double squared = 0.0;
  int well_seen = 0;
  for (const auto& [id, point] : mapper.map().points) {
    const auto& [key_frame, index] = point.observations.front();
    const int landmark = tracker.seen_of(key_frame).landmarks[static_cast<std::size_t>(index)];
    points_of[landmark].insert(id);
    if (point.observations.size() < 5) continue;
    ++well_seen;
    squared +=
        (tracker.T_first() * world.landmarks[static_cast<std::size_t>(landmark)].position_world -
         point.position_world)
            .squaredNorm();
  }
  int doubled = 0;
  for (const auto& [landmark, ids] : points_of) doubled += ids.size() > 1;
  EXPECT_LE(doubled, static_cast<int>(points_of.size() / 50));
  EXPECT_GT(well_seen, 200);
  EXPECT_LT(std::sqrt(squared / well_seen), 0.015);
  // One plane a wall that was seen.
  std::map<int, int> sightings;
  for (const auto& [id, key_frame] : mapper.map().key_frames)
    for (const int k : tracker.seen_of(id).rectangles) ++sightings[k];
  const auto confirmed = std::count_if(mapper.map().planes.begin(), mapper.map().planes.end(),
                                       [](const auto& p) { return p.second.confirmed; });
  EXPECT_EQ(confirmed, std::count_if(sightings.begin(), sightings.end(),
                                     [](const auto& s) { return s.second >= 3; }));
  for (const auto& [id, plane] : mapper.map().planes) {
    const auto& [key_frame, index] = plane.observations.front();
    const int k = tracker.seen_of(key_frame).rectangles[static_cast<std::size_t>(index)];
    const auto& wall = world.rectangles[static_cast<std::size_t>(k)];
    const rgbd::Plane truth =
        in_camera({wall.normal(), wall.normal().dot(wall.corner), false}, tracker.T_first());
    if (!plane.confirmed) continue;
    EXPECT_GT(plane.normal_world.dot(truth.normal), std::cos(0.3 * std::numbers::pi / 180.0));
    EXPECT_NEAR(plane.distance_m, truth.distance_m, 0.015);
  }
}

TEST(Mapper, FarFeaturesWithoutDepthBecomePointsByParallax) {
  MappingWorld world(7);
  world.add_wall({{-3, -1.3, 5}, {0, 2.6, 0}, {6, 0, 0}}, 400);  // beyond the sensor's reach
  world.add_wall({{-1.5, 0.9, 0.5}, {3, 0, 0}, {0, 0, 1.5}}, 300);
  world.depth_reach_m = 3.0;
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  int made = 0;
  for (int step = 0; step < 10; ++step) {
    tracker.step(standing_at({-0.5 + 0.12 * step, 0.0, 0.0}, 0.0));
    made += mapper.report().by_parallax;
  }
  EXPECT_GT(made, 50);
  int far = 0;
  double squared = 0.0;
  for (const auto& [id, point] : mapper.map().points) {
    const auto& [key_frame, index] = point.observations.front();
    const auto at = static_cast<std::size_t>(index);
    if (mapper.map().key_frames.at(key_frame).features[at].depth_m > 0.0f) continue;
    if (point.observations.size() < 4) continue;
    const auto landmark = static_cast<std::size_t>(tracker.seen_of(key_frame).landmarks[at]);
    squared += (tracker.T_first() * world.landmarks[landmark].position_world - point.position_world)
                   .squaredNorm();
    ++far;
  }
  EXPECT_GT(far, 30);
  EXPECT_LT(std::sqrt(squared / far), 0.15);  // at 5 m, by half a pixel over a metre
}

TEST(Mapper, RedundantKeyFramesGoButNotThoseThatBroughtAPlane) {
  MappingWorld world(8);
  world.add_room({0, 0, 0}, 4.0, 2.6, 300);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  int culled = 0;
  for (int step = 0; step < 15; ++step) {
    tracker.step(standing_at({0.01 * step, 0.0, -0.5}, 0.0));
    culled += mapper.report().key_frames_culled;
    ASSERT_EQ(test::inconsistency(mapper.map()), "") << step;
    for (const auto& [id, plane] : mapper.map().planes) {
      const Id first = plane.observations.front().key_frame;
      EXPECT_TRUE(mapper.map().key_frames.at(first).keep);
    }
  }
  EXPECT_GE(culled, 8);
  EXPECT_TRUE(mapper.map().key_frames.contains(0));
  // A plane that comes into view is brought by a key frame that stays, seen however often.
  world.rectangles.push_back({{-0.3, 0.2, 0.5}, {0.6, 0, 0}, {0, 0, 0.5}});
  Id brought = kNoId;
  for (int step = 0; step < 12; ++step) {
    tracker.step(standing_at({0.01 * step, 0.0, -0.5}, 0.0));
    if (step == 0) {
      ASSERT_TRUE(mapper.report().new_planes);
      brought = mapper.report().key_frame;
    }
  }
  EXPECT_TRUE(mapper.map().key_frames.contains(brought));
}

TEST(Mapper, RepeatsToTheBit) {
  Map maps[2];
  for (Map& map : maps) {
    MappingWorld world(4);
    world.add_room({0, 0, 0}, 5.0, 2.6, 300);
    Mapper mapper({}, nullptr);
    TruthfulTracker tracker(world, mapper);
    for (int step = 0; step < 8; ++step) tracker.step(along(step));
    map = mapper.map();
  }
  EXPECT_TRUE(test::same(maps[0], maps[1]));
}

TEST(Mapper, CarriesOverWhatWasTrackedInAnEarlierVersion) {
  MappingWorld world(5);
  world.add_room({0, 0, 0}, 5.0, 2.6, 400);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  for (int step = 0; step < 6; ++step) tracker.step(along(step));
  // Three that were tracked before any of them was answered: no points of the ones between.
  std::vector<NewKeyFrame> pending;
  for (int step = 6; step < 9; ++step) pending.push_back(tracker.next(along(step)));
  for (const auto& key_frame : pending) mapper.add(key_frame);
  EXPECT_EQ(test::inconsistency(mapper.map()), "");
  EXPECT_LT(tracker.worst_m(), 0.01);
  // They share points although none was told: found by projection.
  const Map& map = mapper.map();
  const auto shared = neighbours(map, map.key_frames.at(8), 50);
  EXPECT_TRUE(std::any_of(shared.begin(), shared.end(),
                          [](const Neighbour& n) { return n.key_frame == 7; }));
}

TEST(Mapper, RefusesWhatCannotBe) {
  MappingWorld world(6);
  world.add_room({0, 0, 0}, 5.0, 2.6, 200);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  for (int step = 0; step < 3; ++step) tracker.step(along(step));
  const Map before = mapper.map();
  const NewKeyFrame good = tracker.next(along(3));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refuses = [&](auto change) {
    NewKeyFrame bad = good;
    change(bad);
    EXPECT_THROW(mapper.add(bad), Error);
    EXPECT_TRUE(test::same(mapper.map(), before));
  };
  refuses([&](NewKeyFrame& k) { k.T_camera_world.translation.x() = nan; });
  refuses([](NewKeyFrame& k) { k.T_camera_world.rotation.coeffs() *= 2.0; });
  refuses([](NewKeyFrame& k) { k.points.pop_back(); });
  refuses([](NewKeyFrame& k) { k.planes.push_back(0); });
  refuses([](NewKeyFrame& k) { k.input.frame = 20; });
  refuses([](NewKeyFrame& k) { k.map_version = 17; });
  refuses([](NewKeyFrame& k) { k.map_version = -1; });
  refuses([](NewKeyFrame& k) { k.input.camera.fx += 1.0; });
  refuses([](NewKeyFrame& k) { k.input.features[3].depth_m = -1.0f; });
  refuses([](NewKeyFrame& k) { k.input.features[3].level = 99; });
  refuses([&](NewKeyFrame& k) { k.input.planes[0].plane.normal *= 0.5; });
  refuses([&](NewKeyFrame& k) { k.input.planes[0].covariance(0, 0) = -1.0; });
  // Ids that are not there are no error: the map has moved on.
  NewKeyFrame strange = good;
  strange.reference = 1000;
  strange.points[0] = 123456;
  strange.points[1] = strange.points[2];
  strange.planes[0] = 99;
  strange.seen_points = {{123456, 3, 1}, {strange.points[2], 2, 5}};
  EXPECT_NO_THROW(mapper.add(strange));
  EXPECT_EQ(test::inconsistency(mapper.map()), "");
}

}  // namespace
}  // namespace weft::slam
