#include "messages/grasp.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "stage/stage.hpp"

namespace weft::messages {
namespace {

detector::Grasp grasp() {
  detector::Grasp g;
  g.part = "jeans hips";
  g.detection = 3;
  g.score = 0.4;
  g.pixel = {320.0, 200.0};
  g.point_camera_m = {0.1, -0.2, 1.1};
  g.approach_camera = {0.0, 0.6, 0.8};
  return g;
}

TEST(GraspMessage, CarriesEveryField) {
  grasps_t message;
  to_message({grasp(), grasp()}, std::nullopt, message);
  EXPECT_EQ(message.grasp_count, 2);
  EXPECT_EQ(message.grasps[0].has_base, 0);
  const auto back = from_message(message);
  ASSERT_EQ(back.size(), 2u);
  EXPECT_EQ(back[1].part, "jeans hips");
  EXPECT_EQ(back[1].detection, 3);
  EXPECT_EQ(back[1].score, 0.4);
  EXPECT_EQ(back[1].pixel, grasp().pixel);
  EXPECT_EQ(back[1].point_camera_m, grasp().point_camera_m);
  EXPECT_EQ(back[1].approach_camera, grasp().approach_camera);
}

TEST(GraspMessage, TurnsIntoTheRobotsBase) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  pose.translation() = Eigen::Vector3d(1, 2, 3);
  grasps_t message;
  to_message({grasp()}, pose, message);
  EXPECT_EQ(message.grasps[0].has_base, 1);
  EXPECT_DOUBLE_EQ(message.grasps[0].point_base_m[0], 1.2);
  EXPECT_DOUBLE_EQ(message.grasps[0].point_base_m[1], 2.1);
  EXPECT_DOUBLE_EQ(message.grasps[0].point_base_m[2], 4.1);
  EXPECT_DOUBLE_EQ(message.grasps[0].approach_base[0], -0.6);  // directions do not shift
  EXPECT_DOUBLE_EQ(message.grasps[0].approach_base[2], 0.8);
}

TEST(GraspMessage, RefusesImpossibleContent) {
  const auto refused = [](auto change) {
    grasps_t message;
    to_message({grasp()}, std::nullopt, message);
    change(message.grasps[0]);
    EXPECT_THROW(from_message(message), stage::InvalidInput);
  };
  refused([](grasp_t& g) { g.detection = -1; });
  refused([](grasp_t& g) { g.score = 1.5; });
  refused([](grasp_t& g) { g.score = std::nan(""); });
  refused([](grasp_t& g) { g.pixel[0] = std::nan(""); });
  refused([](grasp_t& g) { g.point_camera_m[2] = INFINITY; });
  refused([](grasp_t& g) { g.approach_camera[0] = 1.0; });
}

}  // namespace
}  // namespace weft::messages
