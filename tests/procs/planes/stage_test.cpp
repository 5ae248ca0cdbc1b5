#include "procs/planes/stage.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "messages/planes.hpp"
#include "messages/rgbd.hpp"
#include "support/one_stage.hpp"
#include "support/plane_scene.hpp"

namespace weft::planes_process {
namespace {

planes_t answer(const rgbd::RgbdFrame& frame, const std::string& settings = "") {
  rgbd_frame_t message{};
  messages::to_message(frame, {}, message);
  test::OneStage stage(make_stage(Settings::from_text(settings, "test")));
  stage.send("RGBD_FRAME", message, 0);
  stage.run();
  return stage.received<planes_t>("PLANES");
}

TEST(PlanesStage, SaysWhatTheExtractorFinds) {
  const auto view = test::render(test::room());
  const auto message = answer(view.frame);
  ASSERT_EQ(int{message.status.code}, int{status_t::OK}) << message.status.text;
  const auto content = messages::from_message(message);
  const auto expected = plane::Extractor({}).extract(view.frame);
  ASSERT_EQ(content.extraction.planes.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(content.extraction.planes[i].plane.normal, expected.planes[i].plane.normal);
  EXPECT_EQ(cv::norm(content.extraction.labels, expected.labels, cv::NORM_INF), 0.0);
}

TEST(PlanesStage, SettingsReachTheExtractor) {
  const auto view = test::render(test::room());
  EXPECT_EQ(answer(view.frame, "extractor: {max_depth_m: 1.0}").plane_count, 0);
  EXPECT_EQ(answer(view.frame, "labels: false").label_size, 0);
  EXPECT_THROW(make_stage(Settings::from_text("extractor: {cell_px: 1}", "test")), Error);
  EXPECT_THROW(make_stage(Settings::from_text("cell_px: 20", "test")), Error);
}

TEST(PlanesStage, AnEmptyImageHasNone) {
  auto frame = test::render(test::room()).frame;
  frame.depth.setTo(0);
  const auto message = answer(frame);
  EXPECT_EQ(int{message.status.code}, int{status_t::NOTHING});
  EXPECT_EQ(message.status.reason, static_cast<int>(stage::Reason::kNoPlane));
}

TEST(PlanesStage, AFrameWithoutDepthFails) {
  rgbd_frame_t message{};
  messages::to_message(test::render(test::room()).frame, {}, message);
  message.depth_encoding = rgbd_frame_t::DEPTH_NONE;
  message.depth_size = 0;
  message.data.clear();
  message.data_size = 0;
  test::OneStage stage(make_stage(Settings::from_text("", "test")));
  stage.send("RGBD_FRAME", message, 0);
  stage.run();
  const auto out = stage.received<planes_t>("PLANES");
  EXPECT_EQ(int{out.status.code}, int{status_t::FAILED});
  EXPECT_EQ(out.status.reason, static_cast<int>(stage::Reason::kInvalidInput));
}

}  // namespace
}  // namespace weft::planes_process
