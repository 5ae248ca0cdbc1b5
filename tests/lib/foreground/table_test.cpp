#include "foreground/table.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/table_scene.hpp"

namespace weft::foreground {
namespace {

using test::TableScene;

cv::Vec3d grey(double, double, bool) { return {150, 150, 150}; }

double angle_deg(const rgbd::Plane& a, const rgbd::Plane& b) {
  return std::acos(std::clamp(a.normal.dot(b.normal), -1.0, 1.0)) * 180.0 / M_PI;
}

TEST(FindTable, FindsTheTableUnderThinCloth) {
  for (const double distance_m : {0.6, 1.05, 1.3})
    for (const double tilt_deg : {0.0, 14.0, -25.0}) {
      TableScene scene;
      scene.colour = grey;
      scene.distance_m = distance_m;
      scene.tilt_deg = tilt_deg;
      scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
      const rgbd::RgbdFrame frame = scene.render();
      const auto table = find_table(frame, {}, {});
      ASSERT_TRUE(table);
      EXPECT_LT(angle_deg(*table, scene.table()), 1.0) << distance_m << " m " << tilt_deg;
      EXPECT_NEAR(table->distance_m, scene.table().distance_m, 0.006);
      EXPECT_GT(table->support, 1000);
      // With the truth excluded, what is left is the sensor's distortion.
      const rgbd::Plane refined = refine_plane(frame, frame.mask, *table);
      EXPECT_LT(angle_deg(refined, scene.table()), 0.4);
      EXPECT_NEAR(refined.distance_m, scene.table().distance_m, 0.003);
    }
}

TEST(FindTable, DoesNotTakeALargeFlatBlanketForTheTable) {
  for (const double thickness_m : {0.02, 0.05})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      TableScene scene;
      scene.colour = grey;
      scene.seed = seed;
      scene.cloth_m = [&](double x, double y) {
        return std::abs(x) < 0.5 && std::abs(y) < 0.38 ? thickness_m : -1.0;
      };
      const rgbd::RgbdFrame frame = scene.render();
      ASSERT_GT(cv::countNonZero(frame.mask), 640 * 480 * 6 / 10);
      TableOptions options;
      options.seed = static_cast<int>(seed);
      const auto table = find_table(frame, {}, options);
      ASSERT_TRUE(table);
      EXPECT_NEAR(table->distance_m, scene.table().distance_m, 0.006) << thickness_m;
      EXPECT_LT(angle_deg(*table, scene.table()), 1.0);
    }
}

TEST(FindTable, LooksAwayFromExcludedPixels) {
  // A box higher than anything else takes most of the image; without it the table is plain.
  TableScene scene;
  scene.colour = grey;
  scene.cloth_m = [](double x, double y) {
    return std::abs(x) < 0.55 && std::abs(y) < 0.4 ? 0.012 : -1.0;
  };
  const rgbd::RgbdFrame frame = scene.render();
  const auto table = find_table(frame, frame.mask, {});
  ASSERT_TRUE(table);
  EXPECT_NEAR(table->distance_m, scene.table().distance_m, 0.004);
}

TEST(FindTable, FindsNoneWhereThereIsNone) {
  TableScene scene;
  scene.colour = grey;
  rgbd::RgbdFrame frame = scene.render();
  rgbd::RgbdFrame empty = frame;
  empty.depth = cv::Mat::zeros(480, 640, CV_16UC1);
  EXPECT_FALSE(find_table(empty, {}, {}));
  Random random(3);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(random.integer(500, 2500));
  EXPECT_FALSE(find_table(frame, {}, {}));
  frame.depth = cv::Mat::zeros(48, 64, CV_16UC1);
  EXPECT_THROW(find_table(frame, {}, {}), Error);
}

TEST(FindTable, StandsMissingDepthAtTheBorder) {
  TableScene scene;
  scene.colour = grey;
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  rgbd::RgbdFrame frame = scene.render();
  // What a picture turned by 45 degrees leaves of the canvas
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      if (std::abs(u - 320) + std::abs(v - 240) > 330) frame.depth.at<std::uint16_t>(v, u) = 0;
  const auto table = find_table(frame, {}, {});
  ASSERT_TRUE(table);
  EXPECT_NEAR(table->distance_m, scene.table().distance_m, 0.006);
}

TEST(FitSurface, RemovesTheSensorsDistortion) {
  TableScene scene;
  scene.colour = grey;
  scene.warp_m = 0.012;
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y, 0.012); };
  const rgbd::RgbdFrame frame = scene.render();
  const rgbd::Plane plane = scene.table();
  const TableSurface surface = fit_surface(frame, {}, plane, 2);
  double plane_error = 0.0, surface_error = 0.0;
  double cloth_m = 0.0;
  int table_px = 0, cloth_px = 0;
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u) {
      const double z_m = frame.depth_m(u, v);
      const double h = surface.height_m(u, v, z_m);
      if (frame.mask.at<std::uint8_t>(v, u)) {
        cloth_m += h;
        ++cloth_px;
      } else {
        const double p = plane.height_m(frame.camera.unproject(u, v, z_m));
        plane_error += p * p;
        surface_error += h * h;
        ++table_px;
      }
    }
  EXPECT_GT(std::sqrt(plane_error / table_px), 0.004);
  EXPECT_LT(std::sqrt(surface_error / table_px), 0.0035);  // noise 2 mm, steps 2 mm
  EXPECT_NEAR(cloth_m / cloth_px, 0.014, 0.002);
}

TEST(FitSurface, IsThePlaneWhenThereIsNothingToGoBy) {
  TableScene scene;
  scene.colour = grey;
  const rgbd::RgbdFrame frame = scene.render();
  const rgbd::Plane plane = scene.table();
  const TableSurface surface =
      fit_surface(frame, cv::Mat(480, 640, CV_8UC1, cv::Scalar(255)), plane, 3);
  for (const double u : {0.0, 300.0, 639.0})
    EXPECT_NEAR(surface.height_m(u, 100.0, 0.9),
                plane.height_m(frame.camera.unproject(u, 100.0, 0.9)), 1e-12);
}

}  // namespace
}  // namespace weft::foreground
