#include "rgbd/surface.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace weft::rgbd {
namespace {

CameraModel camera() { return {320, 240, 262.5, 262.5, 159.5, 119.5}; }

Plane tilted_table() {
  Plane plane;
  plane.normal = Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()) *
                 (Eigen::AngleAxisd(-0.1, Eigen::Vector3d::UnitY()) * -Eigen::Vector3d::UnitZ());
  plane.distance_m = -0.9;
  return plane;
}

/// Depth of the table itself, in tenths of a millimetre.
RgbdFrame table_scene(const Plane& table) {
  RgbdFrame frame;
  frame.camera = camera();
  frame.depth_unit_m = 0.0001;
  frame.colour.create(240, 320, CV_8UC3);
  frame.depth.create(240, 320, CV_16UC1);
  for (int v = 0; v < 240; ++v)
    for (int u = 0; u < 320; ++u) {
      const double z_m = table.distance_m / table.normal.dot(frame.camera.unproject(u, v, 1.0));
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(std::lround(z_m * 1e4));
    }
  return frame;
}

cv::Mat middle_mask() {
  cv::Mat mask = cv::Mat::zeros(240, 320, CV_8UC1);
  mask(cv::Rect(100, 80, 120, 80)).setTo(255);
  return mask;
}

bool missing(const cv::Vec3f& p) {
  return std::isnan(p[0]) && std::isnan(p[1]) && std::isnan(p[2]);
}

TEST(Surface, OfTheSensorViewIsTheBackProjection) {
  RgbdFrame frame = table_scene(tilted_table());
  frame.depth.at<std::uint16_t>(7, 9) = 0;
  const View view = make_view(frame, middle_mask(), nullptr, {.rectified = false});
  const auto surface = render_surface(frame, view);
  ASSERT_EQ(surface.points_m.size(), cv::Size(320, 240));
  for (int v = 0; v < 240; ++v)
    for (int u = 0; u < 320; ++u) {
      const auto p = surface.points_m.at<cv::Vec3f>(v, u);
      if (u == 9 && v == 7) {
        EXPECT_TRUE(missing(p));
        continue;
      }
      const auto expected = frame.camera.unproject(u, v, frame.depth_m(u, v));
      ASSERT_NEAR(p[0], expected.x(), 1e-6);
      ASSERT_NEAR(p[1], expected.y(), 1e-6);
      ASSERT_NEAR(p[2], expected.z(), 1e-6);
    }
}

TEST(Surface, OfATableInTheRectifiedViewIsAPlaneOfTheViewsScale) {
  const Plane table = tilted_table();
  const RgbdFrame frame = table_scene(table);
  const View view = make_view(frame, middle_mask(), &table, {});
  const auto surface = render_surface(frame, view);
  int valid = 0;
  const cv::Vec3f* origin = nullptr;
  int origin_x = 0, origin_y = 0;
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const auto& p = surface.points_m.at<cv::Vec3f>(y, x);
      if (missing(p)) continue;
      ++valid;
      // The table is at its distance from the camera everywhere, and pixels are 1 / scale apart.
      ASSERT_NEAR(p[2], 0.9, 2e-4);
      if (origin == nullptr) {
        origin = &p;
        origin_x = x;
        origin_y = y;
      }
      ASSERT_NEAR(p[0] - (*origin)[0], (x - origin_x) / view.scale_px_per_m, 2e-4);
      ASSERT_NEAR(p[1] - (*origin)[1], (y - origin_y) / view.scale_px_per_m, 2e-4);
    }
  EXPECT_GT(valid, view.width * view.height * 9 / 10);
}

TEST(Surface, FollowsAViewThatIsTurnedAndMirrored) {
  const Plane table = tilted_table();
  const RgbdFrame frame = table_scene(table);
  View view = make_view(frame, middle_mask(), &table, {});
  Eigen::Matrix3d turn;  // old px from new px: mirrored, then turned by 40 degrees about a point
  const double c = std::cos(0.7), s = std::sin(0.7);
  turn << -c, -s, 90.0, -s, c, 60.0, 0, 0, 1;
  view.sensor_from_view *= turn;
  const auto surface = render_surface(frame, view);
  int pairs = 0;
  for (int y = 0; y + 10 < view.height; y += 5)
    for (int x = 0; x + 10 < view.width; x += 5) {
      const auto& p = surface.points_m.at<cv::Vec3f>(y, x);
      const auto& q = surface.points_m.at<cv::Vec3f>(y + 10, x + 10);
      if (missing(p) || missing(q)) continue;
      ++pairs;
      for (int axis = 0; axis < 2; ++axis)
        ASSERT_NEAR(q[axis] - p[axis], 10.0 / view.scale_px_per_m, 3e-4);
      ASSERT_NEAR(p[2], 0.9, 2e-4);
    }
  EXPECT_GT(pairs, 50);
}

TEST(Surface, ProjectsToItsPixels) {
  const Plane table = tilted_table();
  RgbdFrame frame = table_scene(table);
  for (int v = 100; v < 140; ++v)
    for (int u = 140; u < 180; ++u)
      frame.depth.at<std::uint16_t>(v, u) -= static_cast<std::uint16_t>(u + v);
  for (const bool rectified : {false, true}) {
    const View view = make_view(frame, middle_mask(), &table, {.rectified = rectified});
    const auto surface = render_surface(frame, view);
    ASSERT_EQ(surface.camera.width, view.width);
    ASSERT_EQ(surface.camera.height, view.height);
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        const auto& p = surface.points_m.at<cv::Vec3f>(y, x);
        if (missing(p)) continue;
        const Eigen::Vector2d px = surface.camera.project({p[0], p[1], p[2]});
        ASSERT_NEAR(px.x(), x, 1e-3);
        ASSERT_NEAR(px.y(), y, 1e-3);
      }
  }
}

TEST(Surface, KeepsDistancesBetweenPointsWhenRectified) {
  // A bump on the table: the same sensor pixel's point, turned only.
  const Plane table = tilted_table();
  RgbdFrame frame = table_scene(table);
  for (int v = 100; v < 140; ++v)
    for (int u = 140; u < 180; ++u) frame.depth.at<std::uint16_t>(v, u) -= 30;
  const View view = make_view(frame, middle_mask(), &table, {});
  const auto surface = render_surface(frame, view);
  for (int y = 0; y < view.height; y += 3)
    for (int x = 0; x < view.width; x += 3) {
      const auto& p = surface.points_m.at<cv::Vec3f>(y, x);
      if (missing(p)) continue;
      const Eigen::Vector2d sensor = view.to_sensor({x, y});
      // Height above the table and distance from the camera do not depend on the frame.
      const double distance_m = Eigen::Vector3d(p[0], p[1], p[2]).norm();
      const double range = frame.camera.unproject(sensor.x(), sensor.y(), 1.0).norm();
      const auto ray = frame.camera.unproject(sensor.x(), sensor.y(), distance_m / range);
      ASSERT_NEAR(0.9 - static_cast<double>(p[2]), table.height_m(ray), 1e-5);
    }
}

TEST(Surface, IsMissingAtHolesAndAcrossJumps) {
  const Plane table = tilted_table();
  RgbdFrame frame = table_scene(table);
  frame.depth(cv::Rect(130, 100, 4, 4)).setTo(0);
  for (int v = 110; v < 150; ++v)
    for (int u = 150; u < 200; ++u) frame.depth.at<std::uint16_t>(v, u) -= 1500;  // a box, 15 cm
  const View view = make_view(frame, middle_mask(), &table, {});
  const auto surface = render_surface(frame, view);
  int at_hole = 0, at_jump = 0;
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const Eigen::Vector2d s = view.to_sensor({x, y});
      const auto& p = surface.points_m.at<cv::Vec3f>(y, x);
      const bool hole = s.x() > 129.001 && s.x() < 133.999 && s.y() > 99.001 && s.y() < 103.999;
      const bool jump = s.x() > 149.001 && s.x() < 149.999 && s.y() > 111 && s.y() < 148;
      if (hole || jump) {
        EXPECT_TRUE(missing(p)) << s.transpose();
      }
      at_hole += hole ? 1 : 0;
      at_jump += jump ? 1 : 0;
      // Never in between: on the table or on the box.
      if (!missing(p)) {
        EXPECT_TRUE(std::abs(p[2] - 0.9F) < 3e-3F || std::abs(p[2] - 0.9F + 0.15F) < 2e-2F) << p[2];
      }
    }
  EXPECT_GT(at_hole, 10);
  EXPECT_GT(at_jump, 10);
}

TEST(Surface, RefusesWhatDoesNotFit) {
  const RgbdFrame frame = table_scene(tilted_table());
  View view = make_view(frame, middle_mask(), nullptr, {.rectified = false});
  RgbdFrame other = frame;
  other.camera.fx += 1.0;
  EXPECT_THROW(render_surface(other, view), Error);
  other = frame;
  other.depth = frame.depth(cv::Rect(0, 0, 10, 10));
  EXPECT_THROW(render_surface(other, view), Error);
  view.width = 0;
  EXPECT_THROW(render_surface(frame, view), Error);
}

}  // namespace
}  // namespace weft::rgbd
