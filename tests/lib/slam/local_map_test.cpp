#include "slam/local_map.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace weft::slam {
namespace {

const rgbd::CameraModel kCamera{640, 480, 525.0, 525.0, 319.5, 239.5};
const Pyramid kPyramid{8, 1.2};

/// Straight ahead at 2 m, seen before from 2 m at level 3.
LocalPoint ahead() {
  LocalPoint p;
  p.position_world = {0.0, 0.0, 2.0};
  std::tie(p.min_distance_m, p.max_distance_m) = scale_range_m(2.0, 3, 8, 1.2);
  return p;
}

/// Key frames 0 to 3: 0 and 1 share 20 points, 2 shares 16 with 1, 3 shares 5 with 2.
Map some_map() {
  Map map;
  const auto see = [&](Id first, Id last, std::initializer_list<Id> key_frames) {
    for (Id id = first; id < last; ++id) {
      MapPoint& p = map.points[id];
      p.id = id;
      for (const Id k : key_frames) {
        KeyFrame& key_frame = map.key_frames[k];
        key_frame.id = k;
        p.observations.push_back({k, static_cast<int>(key_frame.points.size())});
        key_frame.points.push_back(id);
      }
    }
  };
  see(0, 20, {0, 1});
  see(20, 36, {1, 2});
  see(36, 41, {2, 3});
  return map;
}

TEST(LocalMap, ScaleRangeIsThatOfThePyramid) {
  const auto [least, most] = scale_range_m(2.0, 3, 8, 1.2);
  EXPECT_NEAR(most, 2.0 * 1.2 * 1.2 * 1.2, 1e-12);           // there it is seen at level 0
  EXPECT_NEAR(least, 2.0 / (1.2 * 1.2 * 1.2 * 1.2), 1e-12);  // there at level 7
}

TEST(LocalMap, ProjectsWithTheLevelThatFitsTheDistance) {
  for (int step = -3; step <= 4; ++step) {
    Rigid3d T_camera_world;
    T_camera_world.translation.z() = 2.0 * std::pow(1.2, -step) - 2.0;
    Sought out;
    ASSERT_TRUE(project(ahead(), kCamera, T_camera_world, kPyramid, 5.0, out)) << step;
    EXPECT_NEAR(out.u_px, 319.5f, 1e-4f);
    EXPECT_NEAR(out.v_px, 239.5f, 1e-4f);
    EXPECT_EQ(out.min_level, 3 + step - 1);
    EXPECT_EQ(out.max_level, 3 + step + 1);
    EXPECT_NEAR(out.radius_px, 5.0 * std::pow(1.2, 3 + step), 1e-3);
  }
}

TEST(LocalMap, DoesNotLookForWhatCannotBeSeen) {
  Sought out;
  const auto seen = [&](const LocalPoint& p, const Rigid3d& T_camera_world) {
    return project(p, kCamera, T_camera_world, kPyramid, 5.0, out);
  };
  const auto moved = [](double x, double z) {
    Rigid3d T;
    T.translation = {x, 0.0, z};
    return T;
  };
  EXPECT_TRUE(seen(ahead(), {}));
  EXPECT_FALSE(seen(ahead(), moved(0.0, -2.05))) << "behind the camera";
  EXPECT_FALSE(seen(ahead(), moved(1.3, 0.0))) << "beside the picture";
  EXPECT_FALSE(seen(ahead(), moved(0.0, 3.0))) << "too far for its scale";
  EXPECT_FALSE(seen(ahead(), moved(0.0, -1.3))) << "too near for its scale";
  for (const double degrees : {0.0, 59.0, 61.0, 120.0, 180.0}) {
    LocalPoint p = ahead();
    const double a = degrees * M_PI / 180.0;
    p.viewing_direction = {std::sin(a), 0.0, std::cos(a)};
    EXPECT_EQ(seen(p, {}), degrees < 60.0) << degrees;
  }
}

TEST(LocalMap, KeyFramesAreThoseThatSeeMostThenTheirNeighbours) {
  const Map map = some_map();
  const std::vector<Id> seen = {0, 1, 2, 25, 99};  // 99 is no point of the map
  EXPECT_EQ(local_key_frames(map, seen, kNoId, 10), (std::vector<Id>{1, 0, 2}));
  EXPECT_EQ(local_key_frames(map, seen, kNoId, 2), (std::vector<Id>{1, 0}));
  // Only 2 sees it with 3; 1 shares 16 points with 2, 3 too few to be a neighbour.
  EXPECT_EQ(local_key_frames(map, std::vector<Id>{40}, kNoId, 10), (std::vector<Id>{2, 3, 1}));
  EXPECT_EQ(local_key_frames(map, {}, 0, 10), (std::vector<Id>{0, 1}));
  EXPECT_TRUE(local_key_frames(map, {}, kNoId, 10).empty());
}

TEST(LocalMap, PointsComeOnceEach) {
  const Map map = some_map();
  const auto points = local_points(map, std::vector<Id>{2, 1});
  std::vector<Id> expected;
  for (Id id = 20; id < 41; ++id) expected.push_back(id);
  for (Id id = 0; id < 20; ++id) expected.push_back(id);
  std::vector<Id> ids;
  for (const auto& p : points) ids.push_back(p.id);
  EXPECT_EQ(ids, expected);
}

}  // namespace
}  // namespace weft::slam
