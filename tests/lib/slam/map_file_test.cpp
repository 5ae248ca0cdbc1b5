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

SavedGarments two_garments() {
  SavedGarments out;
  out.next_id = 9;
  for (const Id id : {2, 8}) {
    Garment garment;
    garment.id = id;
    garment.in_map = id == 8;
    garment.position_world = {0.1, -0.2, 1.0 + 0.1 * static_cast<double>(id)};
    garment.covariance = Eigen::Vector3d(1e-4, 2e-4, 3e-4).asDiagonal();
    garment.extent_m = 0.4;
    garment.supporting_plane = id == 8 ? 1 : kNoId;
    garment.sightings = 7;
    garment.consecutive = 3;
    garment.missed = 1;
    garment.anchor = 2;
    garment.position_anchor = {0.0, 0.3, 0.9};
    for (const char* name : {"polo collar", "", "left sleeve"}) {
      if (id == 2) break;
      GarmentPart part;
      part.part = name;
      part.position_world = {0.3, 0.2, 0.1};
      part.covariance = 1e-4 * Eigen::Matrix3d::Identity();
      part.covariance(0, 1) = part.covariance(1, 0) = 2e-5;
      part.probability = 0.3;
      part.sightings = 4;
      part.has_grasp = true;
      part.grasp_score = 0.25;
      part.approach_world = {0.6, 0.0, -0.8};
      part.position_anchor = {1, 2, 3};
      garment.parts.push_back(part);
    }
    out.garments.push_back(garment);
  }
  return out;
}

TEST(MapFile, HoldsTheGarments) {
  SavedMap saved = a_map();
  saved.garments = two_garments();
  const auto bytes = format_map(saved);
  const SavedMap read = parse_map(bytes, "x");
  EXPECT_EQ(format_map(read), bytes);
  ASSERT_EQ(read.garments.garments.size(), 2u);
  EXPECT_EQ(read.garments.next_id, 9);
  const Garment &a = read.garments.garments[1], &b = saved.garments.garments[1];
  EXPECT_TRUE(a.in_map);
  EXPECT_EQ(a.position_world, b.position_world);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.position_anchor, b.position_anchor);
  EXPECT_EQ(a.supporting_plane, 1);
  EXPECT_EQ(a.anchor, 2);
  EXPECT_EQ(a.missed, 1);
  ASSERT_EQ(a.parts.size(), 3u);
  EXPECT_EQ(a.parts[1].part, "");
  EXPECT_EQ(a.parts[2].part, "left sleeve");
  EXPECT_EQ(a.parts[2].covariance, b.parts[2].covariance);
  EXPECT_EQ(a.parts[2].approach_world, b.parts[2].approach_world);
  EXPECT_EQ(a.parts[2].grasp_score, 0.25);
  EXPECT_EQ(read.garments.garments[0].parts.size(), 0u);
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
  refuses("a garment's id beyond the next", [](SavedMap& m) {
    m.garments = two_garments();
    m.garments.next_id = 8;
  });
  refuses("a part's place that is none", [](SavedMap& m) {
    m.garments = two_garments();
    m.garments.garments[1].parts[0].covariance.setZero();
  });
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
