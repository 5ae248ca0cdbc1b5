#include "messages/map_objects.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "stage/stage.hpp"

namespace weft {
namespace {

messages::MapObjectsContent content() {
  slam::GarmentPart part;
  part.part = "jeans hips";
  part.position_world = {0.1, 0.2, 0.3};
  part.covariance << 4, 1, 0, 1, 5, 2, 0, 2, 6;
  part.probability = 0.7;
  part.sightings = 4;
  part.has_grasp = true;
  part.grasp_score = 0.4;
  part.approach_world = {0, 0.6, 0.8};
  slam::Garment garment;
  garment.id = 2;
  garment.in_map = true;
  garment.position_world = {1, 2, 3};
  garment.covariance << 1, 0.1, 0.2, 0.1, 2, 0.3, 0.2, 0.3, 3;
  garment.extent_m = 0.4;
  garment.supporting_plane = 7;
  garment.sightings = 9;
  garment.consecutive = 5;
  garment.missed = 1;
  garment.parts = {part};
  slam::Garment candidate;
  candidate.id = 5;
  const slam::Rigid3d T_base_world{Eigen::Quaterniond(0.8, 0, 0, 0.6), {0.5, 0, 1}};
  return {11, 3, T_base_world, {garment, candidate}};
}

TEST(MapObjects, ComeBackToTheBit) {
  const auto sent = content();
  map_objects_t message{};
  messages::to_message(sent, message);
  const auto back = messages::from_message(message);
  EXPECT_EQ(back.map_id, 11);
  EXPECT_EQ(back.map_version, 3);
  ASSERT_TRUE(back.T_base_world);
  EXPECT_EQ(back.T_base_world->translation, sent.T_base_world->translation);
  ASSERT_EQ(back.garments.size(), 2u);
  const auto& a = sent.garments[0];
  const auto& b = back.garments[0];
  EXPECT_EQ(b.id, a.id);
  EXPECT_EQ(b.in_map, a.in_map);
  EXPECT_EQ(b.position_world, a.position_world);
  EXPECT_EQ(b.covariance, a.covariance);
  EXPECT_EQ(b.extent_m, a.extent_m);
  EXPECT_EQ(b.supporting_plane, a.supporting_plane);
  EXPECT_EQ(b.sightings, a.sightings);
  EXPECT_EQ(b.consecutive, a.consecutive);
  EXPECT_EQ(b.missed, a.missed);
  ASSERT_EQ(b.parts.size(), 1u);
  EXPECT_EQ(b.parts[0].part, a.parts[0].part);
  EXPECT_EQ(b.parts[0].position_world, a.parts[0].position_world);
  EXPECT_EQ(b.parts[0].covariance, a.parts[0].covariance);
  EXPECT_EQ(b.parts[0].probability, a.parts[0].probability);
  EXPECT_EQ(b.parts[0].sightings, a.parts[0].sightings);
  EXPECT_EQ(b.parts[0].has_grasp, a.parts[0].has_grasp);
  EXPECT_EQ(b.parts[0].grasp_score, a.parts[0].grasp_score);
  EXPECT_EQ(b.parts[0].approach_world, a.parts[0].approach_world);
  EXPECT_FALSE(back.garments[1].in_map);
  // What a robot reads: the same place from its base.
  const Eigen::Vector3d in_base = *sent.T_base_world * a.parts[0].position_world;
  EXPECT_EQ(Eigen::Map<const Eigen::Vector3d>(message.objects[0].parts[0].position_base_m),
            in_base);
}

TEST(MapObjects, RefuseWhatCannotBe) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::function<void(map_objects_t&)> faults[] = {
      [](map_objects_t& m) { m.map_id = -1; },
      [](map_objects_t& m) { m.map_version = -1; },
      [](map_objects_t& m) { m.T_base_world.rotation[0] = 3; },
      [](map_objects_t& m) { m.objects[1].id = 2; },
      [nan](map_objects_t& m) { m.objects[0].position_world_m[1] = nan; },
      [](map_objects_t& m) { m.objects[0].covariance[0] = -1; },
      [](map_objects_t& m) { m.objects[0].extent_m = -1; },
      [](map_objects_t& m) { m.objects[0].supporting_plane = -2; },
      [](map_objects_t& m) { m.objects[0].missed = -1; },
      [nan](map_objects_t& m) { m.objects[0].parts[0].position_world_m[0] = nan; },
      [](map_objects_t& m) { m.objects[0].parts[0].probability = 1.5; },
      [](map_objects_t& m) { m.objects[0].parts[0].grasp_score = -0.5; },
      [](map_objects_t& m) { m.objects[0].parts[0].sightings = -1; },
      [](map_objects_t& m) { m.objects[0].parts[0].approach_world[2] = 2; }};
  for (const auto& fault : faults) {
    map_objects_t message{};
    messages::to_message(content(), message);
    fault(message);
    EXPECT_THROW(messages::from_message(message), stage::InvalidInput) << &fault - faults;
  }
}

}  // namespace
}  // namespace weft
