#include "foreground/pieces.hpp"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <set>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::foreground {
namespace {

/// 1 px is 2 mm at 1 m.
rgbd::RgbdFrame flat_frame(double z_m = 1.0) {
  rgbd::RgbdFrame frame;
  frame.camera = {320, 240, 500.0, 500.0, 159.5, 119.5};
  frame.depth = cv::Mat(240, 320, CV_16UC1, cv::Scalar(1000.0 * z_m));
  return frame;
}

cv::Mat mask_of(const std::vector<cv::Rect>& rectangles) {
  cv::Mat mask = cv::Mat::zeros(240, 320, CV_8UC1);
  for (const auto& each : rectangles) mask(each).setTo(255);
  return mask;
}

int label(const Pieces& pieces, int u, int v) { return pieces.labels.at<int>(v, u); }

TEST(Pieces, WhatIsApartIsNumberedInOrderOfFirstPixels) {
  const auto mask = mask_of({{10, 60, 80, 80}, {150, 40, 80, 80}, {60, 160, 90, 70}});
  const Pieces pieces = part_mask(flat_frame(), mask, {});
  EXPECT_EQ(pieces.count, 3);
  EXPECT_EQ(label(pieces, 200, 80), 1);
  EXPECT_EQ(label(pieces, 50, 100), 2);
  EXPECT_EQ(label(pieces, 100, 200), 3);
  EXPECT_EQ(cv::countNonZero((pieces.labels > 0) != (mask > 0)), 0);
}

TEST(Pieces, ANeckPartsAndASleeveDoesNot) {
  // 10 px are 2 cm, 30 px 6 cm.
  for (const auto& [width_px, expected] : {std::pair{10, 2}, {30, 1}}) {
    const Pieces pieces =
        part_mask(flat_frame(),
                  mask_of({{20, 60, 100, 100}, {120, 100, 40, width_px}, {160, 60, 100, 100}}), {});
    EXPECT_EQ(pieces.count, expected) << width_px;
    // Where they are parted, in the middle between them.
    if (expected == 2) {
      EXPECT_EQ(label(pieces, 130, 105), label(pieces, 30, 70));
      EXPECT_EQ(label(pieces, 150, 105), label(pieces, 250, 70));
    }
  }
  // The same neck seen from half as far is half as wide.
  EXPECT_EQ(part_mask(flat_frame(0.5),
                      mask_of({{20, 20, 120, 200}, {140, 100, 20, 24}, {160, 20, 140, 200}}), {})
                .count,
            2);
}

TEST(Pieces, AStepInDepthPartsAlsoThroughAStripWithoutDepth) {
  for (const int strip_px : {0, 8}) {
    auto frame = flat_frame();
    frame.depth(cv::Rect(160, 0, 160, 240)).setTo(1060);
    frame.depth(cv::Rect(160 - strip_px / 2, 0, strip_px, 240)).setTo(0);
    const auto mask = mask_of({{40, 40, 240, 160}});
    const Pieces pieces = part_mask(frame, mask, {});
    EXPECT_EQ(pieces.count, 2) << strip_px;
    EXPECT_EQ(cv::countNonZero(pieces.labels == 0), 320 * 240 - cv::countNonZero(mask));
    for (int v = 40; v < 200; ++v) {
      EXPECT_EQ(label(pieces, 150, v), 1) << strip_px;
      EXPECT_EQ(label(pieces, 170, v), 2) << strip_px;
    }
  }
}

TEST(Pieces, NoiseSlopesHolesAndSmallTatterDoNotPart) {
  auto frame = flat_frame(1.5);
  Random random(4);
  // 45 degrees and 10 mm of noise: at 1.5 m a difference of three standard deviations is 29 mm.
  for (int v = 0; v < 240; ++v) {
    for (int u = 0; u < 320; ++u) {
      const double noise_mm = 10.0 * (2.0 * random.uniform() - 1.0);
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(1500 + 3 * v + noise_mm);
      if (random.uniform() < 0.2) frame.depth.at<std::uint16_t>(v, u) = 0;
    }
  }
  // A strap hangs on by 2 px.
  const auto mask = mask_of({{40, 40, 200, 160}, {240, 100, 20, 2}, {260, 95, 12, 12}});
  const Pieces pieces = part_mask(frame, mask, {});
  EXPECT_EQ(pieces.count, 1);
  EXPECT_EQ(cv::countNonZero((pieces.labels > 0) != (mask > 0)), 0);
}

TEST(Pieces, WhatIsNarrowThroughoutIsWhole) {
  EXPECT_EQ(part_mask(flat_frame(), mask_of({{20, 60, 250, 8}}), {}).count, 1);
  EXPECT_EQ(part_mask(flat_frame(), mask_of({}), {}).count, 0);
  EXPECT_EQ(part_mask(flat_frame(), mask_of({{0, 0, 320, 240}}), {}).count, 1);
  auto blind = flat_frame();
  blind.depth.setTo(0);
  EXPECT_EQ(part_mask(blind, mask_of({{20, 60, 90, 90}, {150, 60, 90, 90}}), {}).count, 2);
}

TEST(Pieces, RefusesAMaskThatDoesNotFit) {
  EXPECT_THROW(part_mask(flat_frame(), cv::Mat::zeros(240, 319, CV_8UC1), {}), Error);
  EXPECT_THROW(part_mask(flat_frame(), cv::Mat::zeros(240, 320, CV_16UC1), {}), Error);
  EXPECT_THROW(part_mask(flat_frame(), mask_of({}), {.neck_m = -1.0}), Error);
}

}  // namespace
}  // namespace weft::foreground
