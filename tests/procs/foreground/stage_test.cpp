#include "procs/foreground/stage.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "foreground/foreground.hpp"
#include "messages/foreground.hpp"
#include "messages/rgbd.hpp"
#include "stage/stage.hpp"
#include "support/one_stage.hpp"
#include "support/table_scene.hpp"

namespace weft::foreground_process {
namespace {

rgbd::RgbdFrame shirt_frame(bool with_shirt = true) {
  test::TableScene scene;
  scene.camera = {320, 240, 262.0, 262.0, 159.5, 119.5};
  scene.colour = [](double x, double y, bool cloth) {
    return cloth ? cv::Vec3d(140, 80, 50) : test::planks(x, y);
  };
  if (with_shirt) scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  return scene.render();
}

foreground_t answer(const rgbd::RgbdFrame& frame, const std::string& settings = "") {
  rgbd_frame_t message{};
  messages::FrameEncoding encoding;
  encoding.colour = messages::FrameEncoding::Colour::kPng;
  messages::to_message(frame, encoding, message);
  test::OneStage stage(make_stage(Settings::from_text(settings, "test")));
  stage.send("RGBD_FRAME", message, 0);
  stage.run();
  return stage.received<foreground_t>("FOREGROUND");
}

int code(const foreground_t& message) { return message.status.code; }
stage::Reason reason(const foreground_t& message) {
  return static_cast<stage::Reason>(message.status.reason);
}

TEST(ForegroundStage, SegmentsTheFrame) {
  const rgbd::RgbdFrame frame = shirt_frame();
  const foreground_t message = answer(frame);
  ASSERT_EQ(code(message), status_t::OK) << message.status.text;
  const foreground::Foreground found = messages::from_message(message);
  EXPECT_GE(test::iou(found.mask, frame.mask), 0.93);
  const foreground::Foreground expected = foreground::find_foreground(frame, {});
  EXPECT_EQ(cv::norm(found.mask, expected.mask, cv::NORM_INF), 0.0);
  ASSERT_TRUE(found.table);
  EXPECT_EQ(found.table->normal, expected.table->normal);
  EXPECT_EQ(found.table->distance_m, expected.table->distance_m);
}

TEST(ForegroundStage, TakesTheDataSetsMask) {
  const rgbd::RgbdFrame frame = shirt_frame();
  const foreground_t message = answer(frame, "mode: dataset");
  ASSERT_EQ(code(message), status_t::OK) << message.status.text;
  EXPECT_EQ(message.source, foreground_t::SOURCE_DATASET);
  EXPECT_EQ(cv::norm(messages::from_message(message).mask, frame.mask, cv::NORM_INF), 0.0);
}

TEST(ForegroundStage, SaysThatThereIsNothing) {
  const foreground_t empty = answer(shirt_frame(false));
  EXPECT_EQ(code(empty), status_t::NOTHING);
  EXPECT_EQ(reason(empty), stage::Reason::kNoGarment);
  EXPECT_EQ(cv::countNonZero(messages::from_message(empty).mask), 0);
  rgbd::RgbdFrame frame = shirt_frame();
  frame.depth = cv::Mat::zeros(frame.depth.size(), CV_16UC1);
  const foreground_t no_table = answer(frame);
  EXPECT_EQ(code(no_table), status_t::NOTHING);
  EXPECT_EQ(reason(no_table), stage::Reason::kNoTable);
}

TEST(ForegroundStage, FailsWithoutWhatItNeeds) {
  rgbd::RgbdFrame frame = shirt_frame();
  frame.mask = cv::Mat();
  EXPECT_EQ(code(answer(frame, "mode: dataset")), status_t::FAILED);
  frame.colour = cv::Mat();
  EXPECT_EQ(code(answer(frame)), status_t::FAILED);
  EXPECT_THROW(make_stage(Settings::from_text("mode: sometimes", "test")), Error);
}

}  // namespace
}  // namespace weft::foreground_process
