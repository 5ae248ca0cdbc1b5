#include "procs/map/sightings.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "base/random.hpp"

namespace weft::map_process {
namespace {

/// A plane of this inverse depth at a pixel, as depth in units of 0.1 mm.
rgbd::RgbdFrame plane_frame(double a, double b, double c) {
  rgbd::RgbdFrame frame;
  frame.camera = {320, 240, 300.0, 300.0, 159.5, 119.5};
  frame.depth_unit_m = 1e-4;
  frame.depth.create(240, 320, CV_16UC1);
  for (int v = 0; v < 240; ++v)
    for (int u = 0; u < 320; ++u)
      frame.depth.at<std::uint16_t>(v, u) =
          static_cast<std::uint16_t>(1e4 / (a + b * (u - 159.5) / 300.0 + c * (v - 119.5) / 300.0));
  return frame;
}

detector::Detection detect(const std::string& part, double u_px, double v_px,
                           double probability = 0.5) {
  detector::Detection out;
  out.part = part;
  out.probability = probability;
  out.centre_sensor_px = {u_px, v_px};
  return out;
}

TEST(Sightings, PiecesAreGarmentsAndDetectionsGoToTheirs) {
  const auto frame = plane_frame(1.0, 0.0, 0.0);  // 1 m; a pixel is 3.3 mm
  cv::Mat mask = cv::Mat::zeros(240, 320, CV_8UC1);
  mask(cv::Rect(20, 50, 100, 80)).setTo(255);
  mask(cv::Rect(180, 50, 81, 61)).setTo(255);
  mask(cv::Rect(100, 200, 10, 10)).setTo(255);  // a crumb
  const std::vector<detector::Detection> detections{
      detect("collar", 220, 80), detect("hips", 40, 60),    detect("unsure", 60, 60, 0.05),
      detect("table", 300, 220), detect("outside", -5, 80), detect("crumb", 105, 205)};
  detector::Grasp grasp;
  grasp.part = "hips";
  grasp.detection = 1;
  grasp.score = 0.7;
  grasp.point_camera_m = {-0.3, -0.1, 0.99};
  grasp.approach_camera = Eigen::Vector3d::UnitZ();
  const auto seen = sight_garments(frame, mask, detections, std::vector{grasp}, {});
  ASSERT_EQ(seen.size(), 2u);
  EXPECT_LT((seen[1].position_camera - frame.camera.unproject(220, 80, 1.0)).norm(), 1e-9);
  EXPECT_NEAR(seen[1].extent_m, 40.0 / 300.0, 1e-9);
  ASSERT_EQ(seen[0].parts.size(), 1u);
  EXPECT_EQ(seen[0].parts[0].part, "hips");
  EXPECT_TRUE(seen[0].parts[0].has_grasp);
  EXPECT_EQ(seen[0].parts[0].position_camera, grasp.point_camera_m);
  EXPECT_EQ(seen[0].parts[0].grasp_score, 0.7);
  ASSERT_EQ(seen[1].parts.size(), 1u);
  EXPECT_EQ(seen[1].parts[0].part, "collar");
  EXPECT_FALSE(seen[1].parts[0].has_grasp);
  EXPECT_LT((seen[1].parts[0].position_camera - frame.camera.unproject(220, 80, 1.0)).norm(), 1e-9);
}

/// Where the same point of the cloth is said to be when the detector errs in the picture, over
/// planes of growing tilt: the mean squared error in units of the covariance is 3 a point.
TEST(Sightings, CovariancesHoldOnSteepCloth) {
  for (const double slope : {0.0, 0.8, 1.6}) {
    const auto frame = plane_frame(0.8, 0.3 * slope, slope);
    cv::Mat mask = cv::Mat::zeros(240, 320, CV_8UC1);
    mask(cv::Rect(90, 70, 140, 100)).setTo(255);
    Random random(3);
    const auto gauss = [&] {
      double sum = -6.0;
      for (int i = 0; i < 12; ++i) sum += random.uniform();
      return sum;
    };
    const double z_m = frame.depth_m(160, 120);
    const Eigen::Vector3d truth = frame.camera.unproject(160, 120, z_m);
    const SightingOptions options;
    double sum = 0.0;
    constexpr int kDraws = 300;
    for (int i = 0; i < kDraws; ++i) {
      const double u = 160.0 + options.sigma_px * gauss(), v = 120.0 + options.sigma_px * gauss();
      const auto seen =
          sight_garments(frame, mask, std::vector{detect("collar", u, v)}, {}, options);
      ASSERT_EQ(seen.size(), 1u) << slope;
      ASSERT_EQ(seen[0].parts.size(), 1u) << slope;
      const auto& part = seen[0].parts[0];
      const Eigen::Vector3d ray = part.position_camera / part.position_camera.z();
      const double noise_m = options.pieces.inverse_depth_per_m * z_m * z_m * gauss();
      const Eigen::Vector3d error = part.position_camera + noise_m * ray - truth;
      sum += error.dot(part.covariance_camera.ldlt().solve(error)) / kDraws;
    }
    EXPECT_GT(sum, 2.4) << slope;
    EXPECT_LT(sum, 3.7) << slope;
  }
}

TEST(Sightings, ADetectionWithoutDepthRoundItHasNoPlace) {
  auto frame = plane_frame(1.0, 0.0, 0.0);
  frame.depth(cv::Rect(140, 100, 40, 40)).setTo(0);
  cv::Mat mask = cv::Mat::zeros(240, 320, CV_8UC1);
  mask(cv::Rect(90, 60, 140, 120)).setTo(255);
  const auto seen = sight_garments(frame, mask, std::vector{detect("collar", 160, 120)}, {}, {});
  ASSERT_EQ(seen.size(), 1u);
  EXPECT_TRUE(seen[0].parts.empty());
}

}  // namespace
}  // namespace weft::map_process
