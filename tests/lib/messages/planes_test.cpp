#include "messages/planes.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>

#include "stage/stage.hpp"
#include "support/plane_scene.hpp"

namespace weft::messages {
namespace {

plane::Extraction extraction() {
  auto scene = test::room();
  scene.tubes = {{{0.2, 0.0, 1.6}, {0.0, 1.0, 0.1}, 0.15}};
  return plane::Extractor({}).extract(test::render(scene).frame);
}

planes_t good() {
  planes_t message{};
  to_message(extraction(), test::PlaneScene{}.camera, true, message);
  return message;
}

TEST(PlanesMessage, EveryNumberComesBack) {
  const auto sent = extraction();
  ASSERT_GE(sent.planes.size(), 3u);
  ASSERT_GE(sent.cylinders.size(), 1u);
  const auto content = from_message(good());
  EXPECT_EQ(content.camera, test::PlaneScene{}.camera);
  ASSERT_EQ(content.extraction.planes.size(), sent.planes.size());
  for (std::size_t i = 0; i < sent.planes.size(); ++i) {
    const auto &a = sent.planes[i], &b = content.extraction.planes[i];
    EXPECT_EQ(a.plane.normal, b.plane.normal);
    EXPECT_EQ(a.plane.distance_m, b.plane.distance_m);
    EXPECT_EQ(a.plane.rms_m, b.plane.rms_m);
    EXPECT_EQ(a.plane.support, b.plane.support);
    EXPECT_EQ(a.covariance, b.covariance);
    EXPECT_EQ(a.cells, b.cells);
    EXPECT_EQ(a.points_camera, b.points_camera);
  }
  ASSERT_EQ(content.extraction.cylinders.size(), sent.cylinders.size());
  for (std::size_t i = 0; i < sent.cylinders.size(); ++i) {
    const auto &a = sent.cylinders[i], &b = content.extraction.cylinders[i];
    EXPECT_EQ(a.point_camera, b.point_camera);
    EXPECT_EQ(a.axis, b.axis);
    EXPECT_EQ(a.radius_m, b.radius_m);
    EXPECT_EQ(a.convex, b.convex);
    EXPECT_EQ(a.rms_m, b.rms_m);
    EXPECT_EQ(a.support, b.support);
    EXPECT_EQ(a.cells, b.cells);
    EXPECT_EQ(a.points_camera, b.points_camera);
  }
  EXPECT_EQ(cv::norm(content.extraction.labels, sent.labels, cv::NORM_INF), 0.0);
}

TEST(PlanesMessage, LabelsMayBeLeftOut) {
  planes_t message{};
  to_message(extraction(), test::PlaneScene{}.camera, false, message);
  EXPECT_EQ(message.label_size, 0);
  EXPECT_TRUE(from_message(message).extraction.labels.empty());
  EXPECT_TRUE(from_message(good(), false).extraction.labels.empty());
}

TEST(PlanesMessage, ImpossibleContentIsRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::function<void(planes_t&)> faults[] = {
      [](planes_t& m) { m.camera_model.fx = 0; },
      [](planes_t& m) { m.planes[0].plane.normal[0] = 2; },
      [&](planes_t& m) { m.planes[0].plane.distance_m = nan; },
      [](planes_t& m) { m.planes[1].plane.support = -1; },
      [&](planes_t& m) { m.planes[1].covariance[1] = nan; },
      [](planes_t& m) { m.planes[1].covariance[3] = -1.0; },
      [](planes_t& m) { m.planes[1].cells = -1; },
      [](planes_t& m) { m.planes[0].points_camera_m.pop_back(); },
      [](planes_t& m) { m.planes[0].points_camera_m[4] = std::numeric_limits<float>::infinity(); },
      [](planes_t& m) { m.cylinders[0].axis_camera[1] = 0.0; },
      [](planes_t& m) { m.cylinders[0].radius_m = 0.0; },
      [&](planes_t& m) { m.cylinders[0].point_camera_m[2] = nan; },
      [](planes_t& m) { m.cylinders[0].cells = -3; },
      [](planes_t& m) { m.cylinders[0].points_camera_m.push_back(1.0f); },
      [](planes_t& m) { m.label_encoding = 7; },
      [](planes_t& m) { m.label_encoding = planes_t::LABELS_NONE; },
      [](planes_t& m) { m.labels.clear(); },
      [](planes_t& m) { m.labels.resize(m.labels.size() / 2); },
      [](planes_t& m) { m.camera_model.width = 320; },
      [](planes_t& m) { m.planes.pop_back(); },  // a label beyond the segments
      [](planes_t& m) { m.planes.resize(300, m.planes[0]); },
  };
  int number = 0;
  for (const auto& fault : faults) {
    planes_t message = good();
    fault(message);
    EXPECT_THROW(from_message(message), stage::InvalidInput) << "fault " << number;
    ++number;
  }
}

}  // namespace
}  // namespace weft::messages
