#include "slam/map_file.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "mapping_world.hpp"
#include "support/files.hpp"

namespace weft::slam {
namespace {

using test::MappingWorld;
using test::standing_at;
using test::TruthfulTracker;

Rigid3d along(int step) {
  return standing_at({-1.0 + 0.1 * step, 0.02 * step, -0.8}, 0.3 - 0.03 * step);
}

SavedMap a_map() {
  MappingWorld world(21);
  world.add_room({0, 0, 0}, 4.0, 2.6, 200);
  MapperOptions options;
  options.redundant_share = 1.0;  // all four stay
  Mapper mapper(options, nullptr);
  TruthfulTracker tracker(world, mapper);
  for (int step = 0; step < 4; ++step) tracker.step(along(step));
  return mapper.saved();
}

TEST(MapFile, GoesOnAsIfItHadNeverStopped) {
  const weft::test::TemporaryFolder folder;
  MappingWorld world(20);
  world.add_room({0, 0, 0}, 4.0, 2.6, 300);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  for (int step = 0; step < 6; ++step) tracker.step(along(step));
  write_map(folder / "map.weft", mapper.saved());
  Mapper again({}, nullptr, read_map(folder / "map.weft"));
  EXPECT_TRUE(test::same(again.map(), mapper.map()));
  EXPECT_EQ(again.frame(), mapper.frame());
  for (int step = 6; step < 12; ++step) {
    const NewKeyFrame next = tracker.next(along(step));
    mapper.add(next);
    again.add(next);
    ASSERT_TRUE(test::same(again.map(), mapper.map())) << step;
  }
  EXPECT_EQ(format_map(again.saved()), format_map(mapper.saved()));
}

TEST(MapFile, ANewSessionCountsItsFramesFromTheStart) {
  MappingWorld world(22);
  world.add_room({0, 0, 0}, 4.0, 2.6, 300);
  Mapper mapper({}, nullptr);
  TruthfulTracker tracker(world, mapper);
  for (int step = 0; step < 4; ++step) tracker.step(along(step));
  SavedMap saved = mapper.saved();
  NewKeyFrame next = tracker.next(along(4));
  next.input.frame = 0;
  EXPECT_THROW(mapper.add(next), Error);
  saved.frame = -1;
  Mapper again({}, nullptr, std::move(saved));
  const MapUpdate update = again.add(next);
  EXPECT_EQ(update.frame, 0);
  EXPECT_EQ(update.from_version, 4);
  ASSERT_EQ(update.new_key_frames.size(), 1u);
  EXPECT_EQ(update.new_key_frames[0].id, 4);  // ids go on
}

TEST(MapFile, AnEmptyMapIsAMap) {
  const auto bytes = format_map({});
  const SavedMap read = parse_map(bytes, "empty");
  EXPECT_TRUE(read.map.key_frames.empty());
  EXPECT_EQ(read.map.version, 0);
  EXPECT_EQ(read.frame, -1);
}

TEST(MapFile, RefusesWhatDoesNotAgree) {
  const SavedMap good = a_map();
  ASSERT_NO_THROW(parse_map(format_map(good), "x"));
  const auto refuses = [&](const char* why, auto change) {
    SavedMap bad = good;
    change(bad);
    EXPECT_THROW(parse_map(format_map(bad), "x"), Error) << why;
  };
  refuses("an id beyond the next", [](SavedMap& m) { m.next.point = 3; });
  refuses("a parent that is not there", [](SavedMap& m) { m.map.key_frames.at(2).parent = 77; });
  refuses("a circle of parents", [](SavedMap& m) { m.map.key_frames.at(1).parent = 3; });
  refuses("a second root", [](SavedMap& m) { m.map.key_frames.at(2).parent = kNoId; });
  refuses("a loop to nowhere", [](SavedMap& m) { m.map.key_frames.at(2).loop_partners = {50}; });
  refuses("a point seen by none",
          [](SavedMap& m) { m.map.points.begin()->second.observations.clear(); });
  refuses("a feature that is not there",
          [](SavedMap& m) { m.map.points.begin()->second.observations[0].index = 100000; });
  refuses("a key frame that is not there",
          [](SavedMap& m) { m.map.points.begin()->second.observations[0].key_frame = 88; });
  refuses("one feature, two points", [](SavedMap& m) {
    auto second = std::next(m.map.points.begin());
    second->second.observations = m.map.points.begin()->second.observations;
  });
  refuses("a rotation that is none",
          [](SavedMap& m) { m.map.key_frames.at(1).T_camera_world.rotation.w() += 1.0; });
  refuses("a normal that is none",
          [](SavedMap& m) { m.map.planes.begin()->second.normal_world *= 2.0; });
  refuses("a negative variance",
          [](SavedMap& m) { m.map.planes.begin()->second.covariance(2, 2) = -1.0; });
  refuses("a young point of the future", [](SavedMap& m) { m.young_points = {1000000}; });
  refuses("a camera without width", [](SavedMap& m) { m.map.key_frames.at(0).camera.width = 0; });
}

}  // namespace
}  // namespace weft::slam
