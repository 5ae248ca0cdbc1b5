#include "detector/grasp.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/table_scene.hpp"

namespace weft::detector {
namespace {

using test::TableScene;

/// A scene whose cloth has the height `cloth_m`, in grey.
TableScene scene_of(std::function<double(double, double)> cloth_m) {
  TableScene scene;
  scene.colour = [](double, double, bool) { return cv::Vec3d(120, 120, 120); };
  scene.cloth_m = std::move(cloth_m);
  return scene;
}

/// A box of the sensor image, upright, around table coordinates.
Detection box(const TableScene& scene, double x_m, double y_m, double size_m,
              double probability = 0.8) {
  const Eigen::Vector3d down = Eigen::Vector3d::UnitX().cross(scene.table().normal);
  const Eigen::Vector3d point =
      Eigen::Vector3d(0, 0, scene.distance_m) + x_m * Eigen::Vector3d::UnitX() + y_m * down;
  Detection detection;
  detection.part = "polo collar";
  detection.probability = probability;
  detection.centre_sensor_px = scene.camera.project(point);
  const double half = 0.5 * size_m * scene.camera.fx / point.z();
  const Eigen::Vector2d c = detection.centre_sensor_px;
  detection.corners_sensor_px = {c + Eigen::Vector2d(-half, -half),
                                 c + Eigen::Vector2d(half, -half), c + Eigen::Vector2d(half, half),
                                 c + Eigen::Vector2d(-half, half)};
  return detection;
}

/// Table coordinates and height of a point in the camera frame.
struct OnTable {
  double x_m, y_m, height_m;
};
OnTable on_table(const TableScene& scene, const Eigen::Vector3d& point) {
  const rgbd::Plane plane = scene.table();
  const Eigen::Vector3d down = Eigen::Vector3d::UnitX().cross(plane.normal);
  const Eigen::Vector3d from_foot = point - Eigen::Vector3d(0, 0, scene.distance_m);
  return {from_foot.x(), down.dot(from_foot), plane.height_m(point)};
}

double angle_deg(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0)) * 180.0 / M_PI;
}

bool sheet(double x, double y) { return std::abs(x) < 0.2 && std::abs(y) < 0.2; }

TEST(Grasp, LiesOnFlatClothAlongItsNormal) {
  for (const double tilt_deg : {0.0, 15.0, -30.0})
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      TableScene scene = scene_of([](double x, double y) { return sheet(x, y) ? 0.01 : -1.0; });
      scene.warp_m = 0.0;
      scene.tilt_deg = tilt_deg;
      scene.seed = seed;
      const rgbd::RgbdFrame frame = scene.render();
      const auto grasps =
          find_grasps(frame, frame.mask, scene.table(), {box(scene, 0.05, 0.03, 0.12)}, {});
      ASSERT_EQ(grasps.size(), 1u);
      const Grasp& grasp = grasps[0];
      EXPECT_EQ(grasp.part, "polo collar");
      EXPECT_NEAR(on_table(scene, grasp.point_camera_m).height_m, 0.01, 0.002);
      EXPECT_LT(angle_deg(grasp.approach_camera, -scene.table().normal), 5.0) << tilt_deg;
      EXPECT_LT((frame.camera.project(grasp.point_camera_m) - grasp.pixel).norm(), 1e-6);
      EXPECT_GT(grasp.score, 0.2);
      EXPECT_LE(grasp.score, 0.8);
    }
}

TEST(Grasp, FollowsASlope) {
  // A tent: its sides rise by 30 degrees to the ridge at x = 0.
  const double rise = std::tan(30.0 * M_PI / 180.0);
  TableScene scene = scene_of(
      [&](double x, double y) { return sheet(x, y) ? 0.005 + rise * (0.2 - std::abs(x)) : -1.0; });
  scene.warp_m = 0.0;
  scene.tilt_deg = 0.0;
  GraspOptions options;
  options.prominence_weight = 0.0;  // the middle of the box, not the ridge
  const rgbd::RgbdFrame frame = scene.render();
  const auto grasps =
      find_grasps(frame, frame.mask, scene.table(), {box(scene, 0.1, 0.0, 0.06)}, options);
  ASSERT_EQ(grasps.size(), 1u);
  const OnTable at = on_table(scene, grasps[0].point_camera_m);
  EXPECT_NEAR(at.height_m, 0.005 + rise * (0.2 - at.x_m), 0.004);
  const Eigen::Vector3d up = Eigen::Vector3d(rise, 0, -1).normalized();
  EXPECT_LT(angle_deg(grasps[0].approach_camera, -up), 5.0);
}

TEST(Grasp, PrefersAFoldToFlatClothNearTheMiddle) {
  // A fold 2 cm high runs 25 mm beside the middle of the box.
  const auto fold = [](double x, double y) {
    return sheet(x, y) ? 0.006 + 0.02 * std::exp(-std::pow((x - 0.025) / 0.012, 2)) : -1.0;
  };
  int on_fold = 0;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    TableScene scene = scene_of(fold);
    scene.seed = seed;
    const rgbd::RgbdFrame frame = scene.render();
    const auto grasps =
        find_grasps(frame, frame.mask, scene.table(), {box(scene, 0.0, 0.0, 0.12)}, {});
    ASSERT_EQ(grasps.size(), 1u);
    const OnTable at = on_table(scene, grasps[0].point_camera_m);
    on_fold += std::abs(at.x_m - 0.025) < 0.008;
    EXPECT_LT(std::abs(at.y_m), 0.03);
  }
  EXPECT_EQ(on_fold, 5);
}

TEST(Grasp, IsNeverOnTheTable) {
  // The mask is 20 px too wide, and the box shows more table than cloth.
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    TableScene scene = scene_of([](double x, double y) { return sheet(x, y) ? 0.008 : -1.0; });
    scene.seed = seed;
    const rgbd::RgbdFrame frame = scene.render();
    cv::Mat wide = frame.mask.clone();
    for (int v = 0; v < 480; ++v)
      for (int u = 0; u + 20 < 640; ++u)
        if (frame.mask.at<std::uint8_t>(v, u + 20)) wide.at<std::uint8_t>(v, u) = 255;
    const auto grasps = find_grasps(frame, wide, scene.table(), {box(scene, -0.22, 0.0, 0.1)}, {});
    for (const Grasp& grasp : grasps) {
      const OnTable at = on_table(scene, grasp.point_camera_m);
      EXPECT_TRUE(sheet(at.x_m, at.y_m)) << at.x_m << " " << at.y_m << ", seed " << seed;
    }
    ASSERT_EQ(grasps.size(), 1u);
  }
}

TEST(Grasp, IsNeverOnAHoleInTheDepth) {
  TableScene scene = scene_of([](double x, double y) { return sheet(x, y) ? 0.01 : -1.0; });
  rgbd::RgbdFrame frame = scene.render();
  const Detection detection = box(scene, 0.0, 0.0, 0.16);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      if ((Eigen::Vector2d(u, v) - detection.centre_sensor_px).norm() < 15)
        frame.depth.at<std::uint16_t>(v, u) = 0;
  const auto grasps = find_grasps(frame, frame.mask, scene.table(), {detection}, {});
  ASSERT_EQ(grasps.size(), 1u);
  EXPECT_GT((grasps[0].pixel - detection.centre_sensor_px).norm(), 15.0);
  EXPECT_LT((grasps[0].pixel - detection.centre_sensor_px).norm(), 30.0);
}

TEST(Grasp, IsMissingWhereThereIsNoPlaceForIt) {
  TableScene scene = scene_of([](double x, double y) { return sheet(x, y) ? 0.01 : -1.0; });
  rgbd::RgbdFrame frame = scene.render();
  // Beside the cloth; off the image; a box without an area; not finite
  std::vector<Detection> nowhere = {box(scene, 0.35, 0.0, 0.1), box(scene, 5.0, 0.0, 0.1),
                                    box(scene, 0.0, 0.0, 0.0), box(scene, 0.0, 0.0, 0.1)};
  nowhere.back().corners_sensor_px[2].x() = std::nan("");
  EXPECT_TRUE(find_grasps(frame, frame.mask, scene.table(), nowhere, {}).empty());
  EXPECT_TRUE(find_grasps(frame, frame.mask, scene.table(), {}, {}).empty());
  const Detection good = box(scene, 0.0, 0.0, 0.1);
  EXPECT_EQ(find_grasps(frame, frame.mask, scene.table(), {good}, {}).size(), 1u);
  EXPECT_EQ(find_grasps(frame, frame.mask, std::nullopt, {good}, {}).size(), 1u);
  frame.depth = cv::Mat::zeros(480, 640, CV_16UC1);
  EXPECT_TRUE(find_grasps(frame, frame.mask, scene.table(), {good}, {}).empty());
  frame.depth = cv::Mat::zeros(48, 64, CV_16UC1);
  EXPECT_THROW(find_grasps(frame, frame.mask, scene.table(), {good}, {}), Error);
}

TEST(Grasp, RanksByDetectionAndPlace) {
  TableScene scene = scene_of([](double x, double y) { return sheet(x, y) ? 0.01 : -1.0; });
  const rgbd::RgbdFrame frame = scene.render();
  const auto grasps =
      find_grasps(frame, frame.mask, scene.table(),
                  {box(scene, 0.1, 0.1, 0.1, 0.3), box(scene, -0.1, -0.1, 0.1, 0.9)}, {});
  ASSERT_EQ(grasps.size(), 2u);
  EXPECT_EQ(grasps[0].detection, 1);
  EXPECT_EQ(grasps[1].detection, 0);
  EXPECT_GT(grasps[0].score, grasps[1].score);
}

TEST(GraspOptions, AcceptsAPoseInEitherForm) {
  GraspOptions options;
  EXPECT_FALSE(base_from_camera(options));
  // A quarter turn about z, then a shift
  options.T_base_camera = {1.0, 2.0, 3.0, 0.0, 0.0, std::sqrt(0.5), std::sqrt(0.5)};
  const auto from_seven = base_from_camera(options);
  options.T_base_camera = {0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1};
  const auto from_sixteen = base_from_camera(options);
  ASSERT_TRUE(from_seven && from_sixteen);
  EXPECT_LT((from_seven->matrix() - from_sixteen->matrix()).norm(), 1e-12);
  EXPECT_LT((*from_seven * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-12);
}

TEST(GraspOptions, RefusesWhatIsNoPose) {
  const auto refused = [](std::vector<double> numbers) {
    GraspOptions options;
    options.T_base_camera = std::move(numbers);
    EXPECT_THROW(options.validate(), Error);
  };
  refused({1, 2, 3});
  refused({0, 0, 0, 0, 0, 0, 0.5});
  refused({0, 0, 0, 0, 0, 0, std::nan("")});
  refused({2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});   // scaled
  refused({-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});  // mirrored
  refused({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1});   // last row
}

}  // namespace
}  // namespace weft::detector
