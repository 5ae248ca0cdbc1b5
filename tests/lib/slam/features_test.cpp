#include "slam/features.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <set>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::slam {
namespace {

constexpr int kWidth = 640, kHeight = 480;

/// Overlapping boxes of random grey on a larger field; `contrast`: their spread about 128.
cv::Mat boxes(int width, int height, int count, int contrast, int seed) {
  Random random(static_cast<std::uint64_t>(seed));
  cv::Mat grey(height, width, CV_8UC1, cv::Scalar(128));
  for (int i = 0; i < count; ++i) {
    const auto x = static_cast<int>(random.integer(-20, width));
    const auto y = static_cast<int>(random.integer(-20, height));
    const cv::Rect box(x, y, static_cast<int>(random.integer(8, 60)),
                       static_cast<int>(random.integer(8, 60)));
    cv::rectangle(grey, box,
                  cv::Scalar(128 + static_cast<double>(random.integer(-contrast, contrast))),
                  cv::FILLED);
  }
  return grey;
}

rgbd::RgbdFrame frame_of(const cv::Mat& grey) {
  rgbd::RgbdFrame frame;
  frame.camera = {grey.cols, grey.rows, 525.0, 525.0, (grey.cols - 1) / 2.0, (grey.rows - 1) / 2.0};
  cv::cvtColor(grey, frame.colour, cv::COLOR_GRAY2BGR);
  frame.depth = cv::Mat(grey.size(), CV_16UC1, cv::Scalar(1500));
  frame.source = "test";
  return frame;
}

/// All corners of the picture as it is: which of a cell's are kept depends on where cells begin.
FeatureOptions all_of_one_level() {
  FeatureOptions options;
  options.levels = 1;
  options.features = 10000;
  options.low_fast_threshold = options.fast_threshold;
  return options;
}

TEST(Features, MoveWithThePicture) {
  const cv::Mat field = boxes(kWidth + 40, kHeight + 40, 900, 100, 1);
  const FeatureExtractor extractor(all_of_one_level());
  const auto a = extractor.extract(frame_of(field(cv::Rect(0, 0, kWidth, kHeight)).clone()));
  const auto b = extractor.extract(frame_of(field(cv::Rect(17, 9, kWidth, kHeight)).clone()));
  std::map<std::pair<float, float>, const Feature*> at;
  for (const auto& f : b) at[{f.u_px, f.v_px}] = &f;
  int expected = 0, same = 0;
  for (const auto& f : a) {
    // The smoothing of the descriptor reaches to the border of both.
    if (f.u_px < 60 || f.v_px < 60 || f.u_px > kWidth - 60 || f.v_px > kHeight - 60) continue;
    ++expected;
    const auto found = at.find({f.u_px - 17, f.v_px - 9});
    if (found == at.end()) continue;
    ++same;
    EXPECT_EQ(f.angle_deg, found->second->angle_deg);
    EXPECT_EQ(f.descriptor, found->second->descriptor);
  }
  ASSERT_GT(expected, 50);
  EXPECT_EQ(same, expected);
}

TEST(Features, TurnWithThePicture) {
  const cv::Mat field = boxes(480, 480, 700, 100, 2);
  cv::Mat turned;
  cv::rotate(field, turned, cv::ROTATE_90_CLOCKWISE);
  const FeatureExtractor extractor(all_of_one_level());
  const auto a = extractor.extract(frame_of(field));
  const auto b = extractor.extract(frame_of(turned));
  std::map<std::pair<float, float>, const Feature*> at;
  for (const auto& f : b) at[{f.u_px, f.v_px}] = &f;
  int same = 0;
  double bits = 0.0;
  for (const auto& f : a) {
    const auto found = at.find({479.0f - f.v_px, f.u_px});
    if (found == at.end()) continue;
    const float turn = std::remainder(found->second->angle_deg - f.angle_deg - 90.0f, 360.0f);
    EXPECT_NEAR(turn, 0.0f, 1.0f);
    ++same;
    bits += hamming_distance(f.descriptor, found->second->descriptor);
  }
  ASSERT_GT(same, 60);
  EXPECT_LT(bits / same, 10.0);  // OpenCV turns the pattern in steps
}

TEST(Features, AreSpreadAndCounted) {
  // Strong corners crowd in one corner of the picture, weak ones lie all over.
  cv::Mat grey = boxes(kWidth, kHeight, 1500, 14, 3);
  boxes(160, 120, 700, 120, 4).copyTo(grey(cv::Rect(0, 0, 160, 120)));
  FeatureOptions options;
  const auto features = FeatureExtractor(options).extract(frame_of(grey));
  EXPECT_LE(features.size(), 1000u);
  EXPECT_GT(features.size(), 900u);
  std::set<int> quarters;
  int crowded = 0;
  for (const auto& f : features) {
    quarters.insert((f.u_px > kWidth / 2 ? 1 : 0) + (f.v_px > kHeight / 2 ? 2 : 0));
    if (f.u_px < 160 && f.v_px < 120) ++crowded;
    EXPECT_GE(f.angle_deg, 0.0f);
    EXPECT_LT(f.angle_deg, 360.0f);
  }
  EXPECT_EQ(quarters.size(), 4u);
  EXPECT_LT(crowded, static_cast<int>(features.size()) / 3);
  // Without the low threshold the weak ones are not there.
  options.low_fast_threshold = options.fast_threshold;
  int weak = 0;
  for (const auto& f : FeatureExtractor(options).extract(frame_of(grey)))
    if (f.u_px > 200 || f.v_px > 160) ++weak;
  EXPECT_LT(weak, static_cast<int>(features.size()) / 2);
}

// One corner seen at every level lies at one place of the full image.
TEST(Features, LevelsAgreeOnThePlace) {
  cv::Mat grey(kHeight, kWidth, CV_8UC1, cv::Scalar(60));
  cv::rectangle(grey, cv::Rect(300, 200, 200, 200), cv::Scalar(200), cv::FILLED);
  cv::GaussianBlur(grey, grey, cv::Size(0, 0), 1.0);
  std::set<int> levels;
  double sum_u = 0.0, sum_v = 0.0;
  int count = 0;
  for (const auto& f : FeatureExtractor({}).extract(frame_of(grey))) {
    const double scale = std::pow(1.2, f.level);
    if (std::abs(f.u_px - 299.5) > 8 * scale || std::abs(f.v_px - 199.5) > 8 * scale) continue;
    levels.insert(f.level);
    sum_u += (f.u_px - 299.5) / scale;
    sum_v += (f.v_px - 199.5) / scale;
    ++count;
  }
  ASSERT_GE(levels.size(), 5u);
  // FAST answers inside the corner, in px of the level, the same in u and v: not at a place that
  // drifts with the level.
  EXPECT_NEAR(sum_u / count, sum_v / count, 0.5);
  EXPECT_LT(std::abs(sum_u / count), 3.0);
}

TEST(Features, HaveDepthOnlyWhereItIsOneSurface) {
  auto frame = frame_of(boxes(kWidth, kHeight, 900, 100, 5));
  frame.depth(cv::Rect(320, 0, 320, 480)).setTo(2500);
  frame.depth(cv::Rect(0, 240, 640, 240)).setTo(0);
  int near = 0, far = 0;
  for (const auto& f : FeatureExtractor({}).extract(frame)) {
    const long u = std::lround(f.u_px), v = std::lround(f.v_px);
    if (v >= 240 || u == 319 || u == 320) {
      EXPECT_EQ(f.depth_m, 0.0f) << u << " " << v;
    } else if (u < 319) {
      EXPECT_FLOAT_EQ(f.depth_m, 1.5f);
      ++near;
    } else {
      EXPECT_FLOAT_EQ(f.depth_m, 2.5f);
      ++far;
    }
  }
  EXPECT_GT(near, 50);
  EXPECT_GT(far, 50);
  FeatureOptions options;
  options.max_depth_m = 2.0;
  for (const auto& f : FeatureExtractor(options).extract(frame)) EXPECT_LT(f.depth_m, 2.0f);
}

TEST(Features, LeaveOutWhatIsExcluded) {
  const auto frame = frame_of(boxes(kWidth, kHeight, 900, 100, 6));
  cv::Mat exclude(kHeight, kWidth, CV_8UC1, cv::Scalar(0));
  exclude(cv::Rect(100, 100, 300, 200)).setTo(255);
  for (const auto& f : FeatureExtractor({}).extract(frame, exclude))
    EXPECT_FALSE(exclude.at<std::uint8_t>(static_cast<int>(std::lround(f.v_px)),
                                          static_cast<int>(std::lround(f.u_px))))
        << f.u_px << " " << f.v_px;
}

TEST(Features, StandImagesWithoutAny) {
  EXPECT_TRUE(
      FeatureExtractor({}).extract(frame_of(cv::Mat(480, 640, CV_8UC1, cv::Scalar(9)))).empty());
  // Smaller than the border of a patch on either side.
  EXPECT_TRUE(FeatureExtractor({}).extract(frame_of(boxes(30, 30, 30, 100, 7))).empty());
  FeatureExtractor({}).extract(frame_of(boxes(45, 300, 100, 100, 8)));
}

TEST(Features, RefuseWhatDoesNotFit) {
  const FeatureExtractor extractor({});
  auto frame = frame_of(boxes(kWidth, kHeight, 100, 100, 9));
  EXPECT_THROW(extractor.extract(frame, cv::Mat(10, 10, CV_8UC1)), Error);
  frame.depth = cv::Mat(10, 10, CV_16UC1);
  EXPECT_THROW(extractor.extract(frame), Error);
  frame = frame_of(boxes(kWidth, kHeight, 100, 100, 9));
  frame.colour = cv::Mat(kHeight, kWidth, CV_8UC1);
  EXPECT_THROW(extractor.extract(frame), Error);
  FeatureOptions options;
  options.low_fast_threshold = 30;
  EXPECT_THROW(FeatureExtractor{options}, Error);
}

}  // namespace
}  // namespace weft::slam
