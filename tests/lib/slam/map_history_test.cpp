#include "slam/map_history.hpp"

#include <gtest/gtest.h>

#include <iterator>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::slam {
namespace {

/// A map that changes at random, and every version it went through.
class World {
 public:
  explicit World(std::uint64_t seed, std::size_t max_removed = 1000)
      : history(max_removed), random_(seed) {
    versions_.push_back(map);
  }

  void step() {
    MapUpdate update;
    update.from_version = map.version;
    update.to_version = map.version + 1;
    update.frame = map.version;
    if (map.key_frames.empty() || random_.below(2) == 0) {
      KeyFrame k;
      k.id = next_key_frame_++;
      k.features.resize(50);
      k.planes.resize(1);
      k.points.assign(50, kNoId);
      update.new_key_frames.push_back(k);
    }
    if (map.key_frames.size() > 3 && random_.below(3) == 0) {
      // The second goes, and with it what saw it changes.
      const Id gone = std::next(map.key_frames.begin())->first;
      update.removed_key_frames.push_back(gone);
      for (auto [id, p] : map.points) {
        const auto before = p.observations.size();
        std::erase_if(p.observations, [&](const Observation& o) { return o.key_frame == gone; });
        if (p.observations.size() != before) update.points.push_back(p);
      }
    }
    if (!map.key_frames.empty()) {
      const Id last = map.key_frames.rbegin()->first;
      MapUpdate::Change change{last, map.key_frames.at(last).T_camera_world, true, kNoId, {}};
      change.T_camera_world.translation.x() += 1.0;
      update.key_frames.push_back(change);
      if (next_point_ < 40) {
        MapPoint p;
        p.id = next_point_;
        p.observations = {{last, static_cast<int>(next_point_)}};
        ++next_point_;
        update.points.push_back(p);
      }
    }
    if (!map.points.empty() && random_.below(3) == 0) {
      const Id gone = map.points.begin()->first;
      std::erase_if(update.points, [&](const MapPoint& p) { return p.id == gone; });
      update.removed_points.push_back(gone);
    }
    apply(update, map);
    history.add(update);
    versions_.push_back(map);
  }

  const Map& version(std::int64_t number) const {
    return versions_[static_cast<std::size_t>(number)];
  }

  Map map;
  MapHistory history;

 private:
  Random random_;
  std::vector<Map> versions_;
  Id next_key_frame_ = 0, next_point_ = 0;
};

void expect_equal(const Map& a, const Map& b) {
  EXPECT_EQ(a.version, b.version);
  ASSERT_EQ(a.key_frames.size(), b.key_frames.size());
  for (const auto& [id, k] : a.key_frames) {
    ASSERT_TRUE(b.key_frames.contains(id));
    EXPECT_EQ(k.T_camera_world.translation, b.key_frames.at(id).T_camera_world.translation);
    EXPECT_EQ(k.points, b.key_frames.at(id).points);
    EXPECT_EQ(k.keep, b.key_frames.at(id).keep);
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (const auto& [id, p] : a.points) {
    ASSERT_TRUE(b.points.contains(id));
    EXPECT_EQ(p.observations, b.points.at(id).observations);
  }
}

TEST(MapHistory, BringsACopyOfAnyVersionUpToDate) {
  World world(1);
  for (int i = 0; i < 40; ++i) world.step();
  for (std::int64_t from = 0; from <= 40; ++from) {
    Map copy = world.version(from);
    const auto update = world.history.since(from, world.map, 40);
    EXPECT_EQ(update.from_version, from);
    EXPECT_EQ(update.to_version, 40);
    apply(update, copy);
    expect_equal(copy, world.map);
  }
}

TEST(MapHistory, ACopyThatHasPartOfAnUpdateAlreadyGoesOnFromThere) {
  World world(2);
  for (int i = 0; i < 30; ++i) world.step();
  const auto update = world.history.since(10, world.map, 30);
  for (std::int64_t has = 10; has <= 30; ++has) {
    Map copy = world.version(has);
    const auto rest = continued_from(update, copy);
    EXPECT_EQ(rest.from_version, has);
    for (const auto& k : rest.new_key_frames) EXPECT_FALSE(copy.key_frames.contains(k.id));
    for (const Id id : rest.removed_key_frames) EXPECT_TRUE(copy.key_frames.contains(id));
    apply(rest, copy);
    expect_equal(copy, world.map);
  }
}

TEST(MapHistory, SendsTheWholeMapToWhoIsTooFarBehind) {
  World world(3, 4);
  for (int i = 0; i < 60; ++i) world.step();
  EXPECT_EQ(world.history.since(1, world.map, 60).from_version, 0);
  EXPECT_EQ(world.history.since(59, world.map, 60).from_version, 59);
  EXPECT_EQ(world.history.since(61, world.map, 60).from_version, 0);  // of another map
  for (std::int64_t from = 1; from <= 60; ++from) {
    Map copy = world.version(from);
    apply(world.history.since(from, world.map, 60), copy);
    expect_equal(copy, world.map);
  }
}

TEST(MapHistory, KnowsNothingOfBeforeItBegan) {
  World world(4);
  for (int i = 0; i < 10; ++i) world.step();
  MapHistory late;
  late.begin(10);
  EXPECT_EQ(late.since(9, world.map, 10).from_version, 0);
  EXPECT_EQ(late.since(10, world.map, 10).from_version, 10);
  MapUpdate gap;
  gap.from_version = 11;
  gap.to_version = 12;
  EXPECT_THROW(late.add(gap), Error);
  late.begin(3);
  EXPECT_THROW(late.since(3, world.map, 10), Error);
}

}  // namespace
}  // namespace weft::slam
