#include "rgbd/cloud.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::rgbd {
namespace {

using test::error_of;

RgbdFrame random_frame(const CameraModel& camera) {
  Random random(1);
  RgbdFrame frame;
  frame.camera = camera;
  frame.depth.create(camera.height, camera.width, CV_16UC1);
  frame.colour.create(camera.height, camera.width, CV_8UC3);
  for (int i = 0; i < camera.width * camera.height; ++i) {
    frame.depth.ptr<std::uint16_t>()[i] =
        static_cast<std::uint16_t>(random.below(4) == 0 ? 0 : random.integer(400, 9000));
    frame.colour.ptr<cv::Vec3b>()[i] = {static_cast<std::uint8_t>(random.below(256)), 1, 2};
  }
  return frame;
}

TEST(Cloud, CameraAndDepthSurviveTheWayThroughACloud) {
  for (const CameraModel& camera :
       {CameraModel{64, 48, 52.5, 53.5, 31.5, 23.5}, CameraModel{32, 20, 60.0, 60.0, 5.0, 30.0}}) {
    const RgbdFrame frame = random_frame(camera);
    const Cloud cloud = cloud_from_frame(frame);
    const CameraFit fit = fit_camera(cloud, "test");
    EXPECT_NEAR(fit.camera.fx, camera.fx, 1e-4);
    EXPECT_NEAR(fit.camera.fy, camera.fy, 1e-4);
    EXPECT_NEAR(fit.camera.cx, camera.cx, 1e-4);
    EXPECT_NEAR(fit.camera.cy, camera.cy, 1e-4);
    EXPECT_LT(fit.max_error_px, 1e-3);
    const RgbdFrame back = frame_from_cloud(cloud, fit.camera, frame.depth_unit_m, "test");
    EXPECT_EQ(0, std::memcmp(back.depth.data, frame.depth.data, frame.depth.total() * 2));
    EXPECT_EQ(0, std::memcmp(back.colour.data, frame.colour.data, frame.colour.total() * 3));
  }
}

TEST(Cloud, WhatIsNoDepthImageIsAnError) {
  const CameraModel camera{64, 48, 52.5, 53.5, 31.5, 23.5};
  const Cloud good = cloud_from_frame(random_frame(camera));
  const auto fit_error = [](const Cloud& cloud) {
    return error_of([&] { fit_camera(cloud, "scan 1"); });
  };
  Cloud cloud = good;
  cloud.width *= cloud.height;
  cloud.height = 1;
  EXPECT_NE(fit_error(cloud).find("scan 1: the cloud is not organised"), std::string::npos);
  cloud = good;
  for (auto& p : cloud.points) p.x() = -p.x();
  EXPECT_NE(fit_error(cloud).find("mirrored"), std::string::npos);
  cloud = good;
  for (auto& p : cloud.points) p = -p;
  EXPECT_NE(fit_error(cloud).find("behind the camera"), std::string::npos);
  cloud = good;
  for (auto& p : cloud.points) p.setConstant(std::numeric_limits<float>::quiet_NaN());
  EXPECT_NE(fit_error(cloud).find("too few"), std::string::npos);
  cloud = good;
  for (auto& p : cloud.points) p = {0, 0, 1};
  EXPECT_NE(fit_error(cloud).find("too close to one ray"), std::string::npos);
  cloud = good;
  cloud.points[700] = {0.5f, 0.0f, 1.0f};
  EXPECT_NE(error_of([&] { frame_from_cloud(cloud, camera, 0.001, "scan 1"); }).find("projects to"),
            std::string::npos);
  EXPECT_NE(error_of([&] { frame_from_cloud(good, camera, 0.00001, "scan 1"); }).find("65535"),
            std::string::npos);
}

}  // namespace
}  // namespace weft::rgbd
