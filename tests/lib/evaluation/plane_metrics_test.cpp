#include "evaluation/plane_metrics.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace weft::evaluation {
namespace {

cv::Mat image(std::initializer_list<int> values) {
  cv::Mat out(1, static_cast<int>(values.size()), CV_8UC1);
  int i = 0;
  for (const int v : values) out.at<std::uint8_t>(0, i++) = static_cast<std::uint8_t>(v);
  return out;
}

TEST(PlaneSegmentation, HandWorked) {
  //                            1: 5 of 6        2: 2 of 4     3: alone   none
  const cv::Mat truth = image({1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 0, 0, 0});
  const cv::Mat labels = image({7, 7, 7, 7, 7, 0, 8, 8, 0, 0, 0, 0, 9, 9, 0});
  const cv::Mat depth(1, 15, CV_8UC1, cv::Scalar(255));
  const auto s = evaluate_segmentation(labels, truth, depth, 0.8, 1);
  EXPECT_EQ(s.truths, 3);
  EXPECT_EQ(s.segments, 3);
  EXPECT_EQ(s.matched, 1);
  EXPECT_DOUBLE_EQ(s.precision, 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(s.recall, 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(s.mean_iou, (5.0 / 6.0 + 0.5 + 0.0) / 3.0);
  EXPECT_DOUBLE_EQ(s.area_iou, (6 * 5.0 / 6.0 + 4 * 0.5) / 12.0);
  ASSERT_EQ(s.matches.size(), 3u);
  EXPECT_EQ(s.matches[1].segment, 8);
  EXPECT_EQ(s.matches[2].segment, 0);
}

TEST(PlaneSegmentation, SmallTruthsAndWhatLiesOnThemDoNotCount) {
  const cv::Mat truth = image({1, 1, 1, 1, 1, 1, 2, 2, 0, 0, 0});
  const cv::Mat labels = image({7, 7, 7, 7, 7, 7, 8, 8, 9, 9, 9});
  const cv::Mat depth(1, 11, CV_8UC1, cv::Scalar(255));
  const auto s = evaluate_segmentation(labels, truth, depth, 0.8, 3);
  EXPECT_EQ(s.truths, 1);
  EXPECT_EQ(s.segments, 2);  // the one on nothing is wrong
  EXPECT_EQ(s.matched, 1);
}

TEST(PlaneSegmentation, PixelsWithoutDepthAreNobodys) {
  const cv::Mat truth = image({1, 1, 1, 1, 2, 2});
  const cv::Mat labels = image({7, 7, 0, 0, 8, 8});
  const auto s = evaluate_segmentation(labels, truth, image({1, 1, 0, 0, 0, 0}), 0.8, 1);
  EXPECT_EQ(s.truths, 1);
  EXPECT_EQ(s.segments, 1);
  EXPECT_DOUBLE_EQ(s.mean_iou, 1.0);
}

TEST(PlaneSegmentation, RefusesWhatCannotBe) {
  const cv::Mat a = image({1, 1}), b = image({1});
  EXPECT_THROW(evaluate_segmentation(a, b, a, 0.8, 1), Error);
  EXPECT_THROW(evaluate_segmentation(a, a, b, 0.8, 1), Error);
  EXPECT_THROW(evaluate_segmentation(a, a, a, 0.5, 1), Error);
  EXPECT_THROW(evaluate_segmentation(a, a, a, 1.1, 1), Error);
}

TEST(FitPlane, FindsThePlaneAndLeavesStrangersOut) {
  rgbd::RgbdFrame frame;
  frame.camera = {100, 80, 100.0, 100.0, 49.5, 39.5};
  frame.depth_unit_m = 1e-4;
  frame.depth.create(80, 100, CV_16UC1);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.2, -0.3, -1.0).normalized();
  for (int v = 0; v < 80; ++v)
    for (int u = 0; u < 100; ++u) {
      const double z = -1.2 / normal.dot(frame.camera.unproject(u, v, 1.0));
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(z / 1e-4 + 0.5);
    }
  cv::Mat mask(80, 100, CV_8UC1, cv::Scalar(255));
  frame.depth(cv::Rect(0, 0, 3, 80)) = 30000;  // another surface at the border
  const auto plane = fit_plane(frame, mask);
  EXPECT_LT((plane.normal - normal).norm(), 1e-3);
  EXPECT_NEAR(plane.distance_m, -1.2, 1e-3);
  EXPECT_LT(plane.support, 80 * 100);
  mask.setTo(0);
  EXPECT_THROW(fit_plane(frame, mask), Error);
}

}  // namespace
}  // namespace weft::evaluation
