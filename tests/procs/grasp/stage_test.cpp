#include "procs/grasp/stage.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "messages/detections.hpp"
#include "messages/foreground.hpp"
#include "messages/grasp.hpp"
#include "messages/rgbd.hpp"
#include "stage/stage.hpp"
#include "support/one_stage.hpp"
#include "support/table_scene.hpp"

namespace weft::grasp_process {
namespace {

struct GraspStage : testing::Test {
  GraspStage() {
    scene.colour = [](double, double, bool) { return cv::Vec3d(100, 100, 100); };
    scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y, 0.01); };
    frame = scene.render();
    foreground.mask = frame.mask;
    foreground.table = scene.table();
    view.sensor = frame.camera;
    view.width = 640;
    view.height = 480;
    detection.part = "polo collar";
    detection.probability = 0.6;
    detection.box_view = {270.0, 190.0, 100.0, 100.0};
    detection.centre_sensor_px = {320.0, 240.0};
    detection.corners_sensor_px = {Eigen::Vector2d(270, 190), Eigen::Vector2d(370, 190),
                                   Eigen::Vector2d(370, 290), Eigen::Vector2d(270, 290)};
  }
  grasps_t answer(const std::string& settings = "") {
    rgbd_frame_t frame_message{};
    messages::to_message(frame, {}, frame_message);
    foreground_t foreground_message{};
    messages::to_message(foreground, foreground_message);
    part_detections_t detections{};
    detections.status = detections_status;
    messages::to_message(view, {detection}, 1, detections);
    test::OneStage stage(make_stage(Settings::from_text(settings, "test")));
    stage.send("RGBD_FRAME", frame_message, 0);
    stage.send("FOREGROUND", foreground_message, 0);
    stage.send("PART_DETECTIONS", detections, 0);
    stage.run();
    return stage.received<grasps_t>("GRASPS");
  }
  test::TableScene scene;
  rgbd::RgbdFrame frame;
  foreground::Foreground foreground;
  rgbd::View view;
  detector::Detection detection;
  status_t detections_status{};
};

TEST_F(GraspStage, AnswersAPointOnTheCloth) {
  const grasps_t message = answer();
  ASSERT_EQ(int{message.status.code}, int{status_t::OK}) << message.status.text;
  const auto grasps = messages::from_message(message);
  ASSERT_EQ(grasps.size(), 1u);
  EXPECT_EQ(grasps[0].part, "polo collar");
  EXPECT_GT(scene.table().height_m(grasps[0].point_camera_m), 0.005);
  EXPECT_GT(grasps[0].approach_camera.z(), 0.9);
  EXPECT_EQ(int{message.grasps[0].has_base}, 0);
}

TEST_F(GraspStage, KnowsTheRobotsBase) {
  // The camera hangs 1.2 m above the base's origin and looks down.
  const grasps_t message = answer("T_base_camera: [0, 0, 1.2, 1, 0, 0, 0]");
  ASSERT_EQ(message.grasps.size(), 1u);
  const grasp_t& grasp = message.grasps[0];
  EXPECT_EQ(int{grasp.has_base}, 1);
  EXPECT_DOUBLE_EQ(grasp.point_base_m[0], grasp.point_camera_m[0]);
  EXPECT_DOUBLE_EQ(grasp.point_base_m[1], -grasp.point_camera_m[1]);
  EXPECT_DOUBLE_EQ(grasp.point_base_m[2], 1.2 - grasp.point_camera_m[2]);
  EXPECT_LT(grasp.approach_base[2], -0.9);
  EXPECT_THROW(make_stage(Settings::from_text("T_base_camera: [1, 2]", "test")), Error);
}

TEST_F(GraspStage, SaysThatThereIsNothing) {
  detection.corners_sensor_px = {Eigen::Vector2d(2, 2), Eigen::Vector2d(20, 2),
                                 Eigen::Vector2d(20, 20), Eigen::Vector2d(2, 20)};
  const grasps_t nowhere = answer();
  EXPECT_EQ(int{nowhere.status.code}, int{status_t::NOTHING});
  EXPECT_EQ(nowhere.status.reason, static_cast<int>(stage::Reason::kNothingFound));
  detections_status.code = status_t::NOTHING;
  detections_status.reason = static_cast<std::int16_t>(stage::Reason::kNoWords);
  const grasps_t upstream = answer();
  EXPECT_EQ(int{upstream.status.code}, int{status_t::NOTHING});
  EXPECT_EQ(upstream.status.reason, static_cast<int>(stage::Reason::kNoWords));
}

TEST_F(GraspStage, FailsOnAMaskOfAnotherSize) {
  foreground.mask = cv::Mat(240, 320, CV_8UC1, cv::Scalar(255));
  const grasps_t message = answer();
  EXPECT_EQ(int{message.status.code}, int{status_t::FAILED});
  EXPECT_EQ(message.status.reason, static_cast<int>(stage::Reason::kInvalidInput));
}

}  // namespace
}  // namespace weft::grasp_process
