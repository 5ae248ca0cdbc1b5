#include "rgbd/view.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::rgbd {
namespace {

CameraModel camera() { return {640, 480, 525.0, 525.0, 319.5, 239.5}; }

/// A table at `distance_m` along its normal, tilted about the camera's x and y axes.
Plane table(double distance_m, double tilt_x_deg, double tilt_y_deg) {
  const double rad = M_PI / 180.0;
  Plane plane;
  plane.normal =
      Eigen::AngleAxisd(tilt_x_deg * rad, Eigen::Vector3d::UnitX()) *
      (Eigen::AngleAxisd(tilt_y_deg * rad, Eigen::Vector3d::UnitY()) * -Eigen::Vector3d::UnitZ());
  plane.distance_m = -distance_m;
  return plane;
}

/// Table coordinates of a sensor pixel: x along the camera's x projected to the table, y down,
/// from the foot of the perpendicular through `centre`. Written with lines and planes, not with a
/// homography.
Eigen::Vector2d on_table(const Plane& plane, const CameraModel& cam, double u, double v,
                         const Eigen::Vector3d& centre) {
  const Eigen::Vector3d ray = cam.unproject(u, v, 1.0);
  const Eigen::Vector3d point = ray * (plane.distance_m / plane.normal.dot(ray));
  const Eigen::Vector3d across = plane.normal.cross(Eigen::Vector3d::UnitX());
  const Eigen::Vector3d down = -across.normalized();
  const Eigen::Vector3d right = down.cross(-plane.normal);
  return {right.dot(point - centre), down.dot(point - centre)};
}

/// A smooth pattern of the table, 40 to 216 with features of a few centimetres.
double pattern(const Eigen::Vector2d& m) {
  return 128.0 + 44.0 * std::sin(60.0 * m.x() + 10.0 * m.y()) + 44.0 * std::cos(50.0 * m.y());
}

Eigen::Vector3d centre_of(const Plane& plane) {
  return Eigen::Vector3d(0, 0, plane.distance_m / plane.normal.z());
}

/// The patterned table with a garment mask of 0.3 m by 0.2 m around the optical axis.
RgbdFrame scene(const Plane& plane, const CameraModel& cam, cv::Mat* mask) {
  RgbdFrame frame;
  frame.camera = cam;
  frame.depth_unit_m = 0.0001;
  frame.colour.create(cam.height, cam.width, CV_8UC3);
  frame.depth.create(cam.height, cam.width, CV_16UC1);
  mask->create(cam.height, cam.width, CV_8UC1);
  for (int v = 0; v < cam.height; ++v)
    for (int u = 0; u < cam.width; ++u) {
      const Eigen::Vector2d m = on_table(plane, cam, u, v, centre_of(plane));
      const auto grey = static_cast<std::uint8_t>(std::lround(pattern(m)));
      frame.colour.at<cv::Vec3b>(v, u) = {grey, static_cast<std::uint8_t>(255 - grey), grey};
      const Eigen::Vector3d ray = cam.unproject(u, v, 1.0);
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(
          std::lround(plane.distance_m / plane.normal.dot(ray) / frame.depth_unit_m));
      mask->at<std::uint8_t>(v, u) = std::abs(m.x()) < 0.15 && std::abs(m.y()) < 0.1 ? 255 : 0;
    }
  return frame;
}

struct Pose {
  double distance_m, tilt_x_deg, tilt_y_deg;
};

TEST(View, ShowsTheSamePictureFromEveryDistanceAndTilt) {
  for (const Pose& pose : {Pose{0.7, 0, 0}, Pose{0.7, 15, 0}, Pose{1.0, 0, -15}, Pose{1.2, 10, 10},
                           Pose{0.5, -25, 8}}) {
    const Plane plane = table(pose.distance_m, pose.tilt_x_deg, pose.tilt_y_deg);
    cv::Mat mask;
    const RgbdFrame frame = scene(plane, camera(), &mask);
    const View view = make_view(frame, mask, &plane, {});
    const ViewImages images = render_view(frame, mask, view);
    ASSERT_EQ(images.colour.size(), cv::Size(view.width, view.height));
    EXPECT_NEAR(view.width, (0.3 + 0.08) * 600, 5) << pose.distance_m << " " << pose.tilt_x_deg;
    EXPECT_NEAR(view.height, (0.2 + 0.08) * 600, 5);
    const Eigen::Vector2d origin_px =
        view.to_view(camera().project(centre_of(plane)));  // of the pattern
    double worst = 0.0;
    int garment = 0;
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        const Eigen::Vector2d m = (Eigen::Vector2d(x, y) - origin_px) / 600.0;
        worst = std::max(worst, std::abs(images.colour.at<cv::Vec3b>(y, x)[0] - pattern(m)));
        const bool inside = std::abs(m.x()) < 0.147 && std::abs(m.y()) < 0.097;
        const bool outside = std::abs(m.x()) > 0.153 || std::abs(m.y()) > 0.103;
        if (inside || outside) {
          EXPECT_EQ(images.mask.at<std::uint8_t>(y, x), inside ? 255 : 0);
        }
        garment += images.mask.at<std::uint8_t>(y, x) != 0;
      }
    EXPECT_LT(worst, 3.0) << pose.distance_m << " m, " << pose.tilt_x_deg << " deg";
    EXPECT_NEAR(garment, 0.06 * 600 * 600, 0.02 * 0.06 * 600 * 600);
  }
}

TEST(View, MapsPointsOfTheTableThereAndBack) {
  const Plane plane = table(1.1, 12, -7);
  cv::Mat mask;
  const RgbdFrame frame = scene(plane, camera(), &mask);
  const View view = make_view(frame, mask, &plane, {});
  Random random(1);
  const Eigen::Vector2d zero = on_table(plane, camera(), 100, 100, Eigen::Vector3d::Zero());
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector2d px(random.uniform(0, 639), random.uniform(0, 479));
    EXPECT_LT((view.to_sensor(view.to_view(px)) - px).norm(), 1e-9);
    // Distances in the view are distances on the table, at the fixed scale.
    const Eigen::Vector2d m =
        on_table(plane, camera(), px.x(), px.y(), Eigen::Vector3d::Zero()) - zero;
    EXPECT_LT((view.to_view(px) - view.to_view({100, 100}) - 600.0 * m).norm(), 1e-6);
  }
}

TEST(View, EqualsBruteForceBilinearInterpolation) {
  const Plane plane = table(0.9, 10, 5);
  cv::Mat mask;
  RgbdFrame frame = scene(plane, camera(), &mask);
  Random random(2);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      for (int c = 0; c < 3; ++c)
        frame.colour.at<cv::Vec3b>(v, u)[c] = static_cast<std::uint8_t>(random.below(256));
  const View view = make_view(frame, mask, &plane, {});
  const ViewImages images = render_view(frame, mask, view);
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const Eigen::Vector2d px = view.to_sensor(Eigen::Vector2d(x, y));
      const int u = static_cast<int>(std::floor(px.x())), v = static_cast<int>(std::floor(px.y()));
      ASSERT_TRUE(u >= 0 && u < 639 && v >= 0 && v < 479);
      const double a = px.x() - u, b = px.y() - v;
      for (int c = 0; c < 3; ++c) {
        const double expected = (1 - b) * ((1 - a) * frame.colour.at<cv::Vec3b>(v, u)[c] +
                                           a * frame.colour.at<cv::Vec3b>(v, u + 1)[c]) +
                                b * ((1 - a) * frame.colour.at<cv::Vec3b>(v + 1, u)[c] +
                                     a * frame.colour.at<cv::Vec3b>(v + 1, u + 1)[c]);
        // 1/512 px of rounding in each direction and 1/2 of a level
        ASSERT_NEAR(images.colour.at<cv::Vec3b>(y, x)[c], expected, 0.5 + 2 * 255.0 / 512 + 1e-6);
      }
      const int nu = static_cast<int>(std::floor(px.x() + 0.5));
      const int nv = static_cast<int>(std::floor(px.y() + 0.5));
      ASSERT_EQ(images.mask.at<std::uint8_t>(y, x), mask.at<std::uint8_t>(nv, nu));
    }
  // A frame decoded without colour, for descriptors of depth: the same mask.
  frame.colour.release();
  const ViewImages mask_only = render_view(frame, mask, view);
  EXPECT_TRUE(mask_only.colour.empty());
  EXPECT_EQ(cv::countNonZero(mask_only.mask != images.mask), 0);
}

TEST(View, AveragesBeforeItShrinks) {
  // A one-pixel chequerboard seen at four times the view's scale is flat grey in the view.
  const Plane plane = table(0.5, 0, 0);
  const CameraModel fine{640, 480, 1200.0, 1200.0, 319.5, 239.5};
  cv::Mat mask;
  RgbdFrame frame = scene(plane, fine, &mask);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      frame.colour.at<cv::Vec3b>(v, u) = cv::Vec3b::all((u + v) % 2 ? 200 : 100);
  ViewOptions options;
  options.margin_m = 0.0;
  mask = 255;
  const ViewImages images = render_view(frame, mask, make_view(frame, mask, &plane, options));
  for (int y = 1; y + 1 < images.colour.rows; ++y)
    for (int x = 1; x + 1 < images.colour.cols; ++x)
      ASSERT_EQ(images.colour.at<cv::Vec3b>(y, x), cv::Vec3b::all(150));
}

TEST(View, RepeatsTheBorderInColourAndEndsTheMaskThere) {
  const Plane plane = table(1.0, 0, 0);
  cv::Mat mask;
  RgbdFrame frame = scene(plane, camera(), &mask);
  frame.colour = cv::Scalar::all(77);
  mask = 255;
  const View view = make_view(frame, mask, &plane, {});
  const ViewImages images = render_view(frame, mask, view);
  EXPECT_EQ(images.colour.at<cv::Vec3b>(0, 0), cv::Vec3b::all(77));
  EXPECT_EQ(images.mask.at<std::uint8_t>(0, 0), 0);
  EXPECT_EQ(images.mask.at<std::uint8_t>(view.height / 2, view.width / 2), 255);
}

TEST(View, CutsALargeGarmentAroundItsMiddle) {
  const Plane plane = table(1.0, 5, 0);
  cv::Mat mask;
  const RgbdFrame frame = scene(plane, camera(), &mask);
  ViewOptions options;
  options.max_size_px = 100;
  const View view = make_view(frame, mask, &plane, options);
  EXPECT_EQ(view.width, 100);
  EXPECT_EQ(view.height, 100);
  const Eigen::Vector2d middle = view.to_view(camera().project(centre_of(plane)));
  EXPECT_LT((middle - Eigen::Vector2d(50, 50)).norm(), 4.0);
}

TEST(View, LeavesTheSensorImageAloneWhenNotRectified) {
  const Plane plane = table(1.0, 5, 0);
  cv::Mat mask;
  const RgbdFrame frame = scene(plane, camera(), &mask);
  ViewOptions options;
  options.rectified = false;
  const View view = make_view(frame, mask, nullptr, options);
  const ViewImages images = render_view(frame, mask, view);
  EXPECT_EQ(view.kind, View::Kind::kSensor);
  EXPECT_EQ(images.colour.data, frame.colour.data);
  EXPECT_EQ(images.mask.data, mask.data);
  EXPECT_EQ(view.to_view({3, 4}), Eigen::Vector2d(3, 4));
}

TEST(View, RefusesWhatItCannotRectify) {
  const Plane plane = table(1.0, 5, 0);
  const Plane oblique = table(1.0, 80, 0);
  cv::Mat mask;
  const RgbdFrame frame = scene(plane, camera(), &mask);
  EXPECT_THROW(make_view(frame, mask, nullptr, {}), Error);
  EXPECT_THROW(make_view(frame, mask, &oblique, {}), Error);
  EXPECT_THROW(make_view(frame, cv::Mat::zeros(480, 640, CV_8UC1), &plane, {}), Error);
  EXPECT_THROW(make_view(frame, cv::Mat::zeros(48, 64, CV_8UC1), &plane, {}), Error);
  View view = make_view(frame, mask, &plane, {});
  view.sensor.fx = 500;
  EXPECT_THROW(render_view(frame, mask, view), Error);
}

}  // namespace
}  // namespace weft::rgbd
