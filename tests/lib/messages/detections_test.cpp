#include "messages/detections.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "messages/prior.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

using detector::PriorMode;

rgbd::View sensor_view() {
  rgbd::View view;
  view.width = 640;
  view.height = 480;
  view.sensor = {640, 480, 525, 525, 319.5, 239.5};
  return view;
}

detector::Detection detection() {
  detector::Detection d;
  d.part = "polo collar";
  d.probability = 0.75;
  d.box_view = {10.5, 20.25, 60, 48};
  d.centre_sensor_px = {40.5, 44.25};
  d.corners_sensor_px = {{{10.5, 20.25}, {70.5, 20.25}, {70.5, 68.25}, {10.5, 68.25}}};
  return d;
}

TEST(DetectionsMessage, CarriesEverything) {
  part_detections_t message;
  to_message(sensor_view(), {detection(), detection()}, 0xfedcba9876543210u, message);
  EXPECT_EQ(message.detection_count, 2);
  EXPECT_EQ(static_cast<std::uint64_t>(message.model_hash), 0xfedcba9876543210u);
  const auto content = from_message(message);
  EXPECT_EQ(content.view.width, 640);
  ASSERT_EQ(content.detections.size(), 2u);
  const auto& d = content.detections[1];
  EXPECT_EQ(d.part, "polo collar");
  EXPECT_EQ(d.probability, 0.75);
  EXPECT_EQ(d.box_view.y, 20.25);
  EXPECT_EQ(d.box_view.height, 48.0);
  EXPECT_EQ(d.centre_sensor_px, Eigen::Vector2d(40.5, 44.25));
  EXPECT_EQ(d.corners_sensor_px[2], Eigen::Vector2d(70.5, 68.25));
}

TEST(DetectionsMessage, RefusesImpossibleContent) {
  const auto refused = [](auto change) {
    part_detections_t message;
    to_message(sensor_view(), {detection()}, 1, message);
    change(message);
    EXPECT_THROW(from_message(message), stage::InvalidInput);
  };
  refused([](auto& m) { m.detections[0].part = "sock toe"; });
  refused([](auto& m) { m.detections[0].probability = 1.5; });
  refused([](auto& m) { m.detections[0].probability = std::nan(""); });
  refused([](auto& m) { m.detections[0].width_view = 0.0; });
  refused([](auto& m) { m.detections[0].x_view = HUGE_VAL; });
  refused([](auto& m) { m.detections[0].centre_sensor[1] = std::nan(""); });
  refused([](auto& m) { m.detections[0].corners_sensor[3][0] = std::nan(""); });
  refused([](auto& m) { m.view.width = 0; });
}

TEST(PriorMessage, CarriesEverything) {
  for (const auto mode : {PriorMode::kOff, PriorMode::kSoft, PriorMode::kHard}) {
    image_prior_t message;
    to_message({{"jeans hips", 0.25, 0.5, false}, {"polo collar", 1.0, 0.0, true}}, mode, 9,
               message);
    EXPECT_EQ(message.part_count, 2);
    EXPECT_EQ(message.model_hash, 9);
    const auto content = from_message(message);
    EXPECT_EQ(content.mode, mode);
    ASSERT_EQ(content.parts.size(), 2u);
    EXPECT_EQ(content.parts[0].part, "jeans hips");
    EXPECT_EQ(content.parts[0].probability, 0.25);
    EXPECT_EQ(content.parts[0].threshold, 0.5);
    EXPECT_FALSE(content.parts[0].searched);
    EXPECT_TRUE(content.parts[1].searched);
  }
}

TEST(PriorMessage, RefusesImpossibleContent) {
  const auto refused = [](auto change) {
    image_prior_t message;
    to_message({{"jeans hips", 0.25, 0.5, false}, {"polo collar", 1.0, 0.0, true}},
               PriorMode::kHard, 9, message);
    change(message);
    EXPECT_THROW(from_message(message), stage::InvalidInput);
  };
  refused([](auto& m) { m.mode = 3; });
  refused([](auto& m) { m.parts[0].part = "sock toe"; });
  refused([](auto& m) { m.parts[0].part = "polo collar"; });
  refused([](auto& m) { m.parts[0].probability = -0.1; });
  refused([](auto& m) { m.parts[0].threshold = std::nan(""); });
}

}  // namespace
}  // namespace weft::messages
