#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <set>

#include "synth/sensor.hpp"

namespace weft::synth {
namespace {

IdealImages flat_wall(float z) {
  IdealImages i;
  i.depth_m = cv::Mat(480, 640, CV_32FC1, cv::Scalar(z));
  i.cosine = cv::Mat(480, 640, CV_32FC1, cv::Scalar(1));
  i.object = cv::Mat(480, 640, CV_8UC1, cv::Scalar(0));
  i.shadow = cv::Mat(480, 640, CV_8UC1, cv::Scalar(0));
  return i;
}

double deviation(const cv::Mat& image, int channel) {
  double sum = 0.0, squares = 0.0;
  int count = 0;
  for (int y = 200; y < 280; ++y) {
    for (int x = 280; x < 360; ++x, ++count) {
      const double v = image.at<cv::Vec3b>(y, x)[channel];
      sum += v;
      squares += v * v;
    }
  }
  return std::sqrt(squares / count - sum / count * sum / count);
}

TEST(SenseColour, NoiseHasTheSizeAskedFor) {
  const cv::Mat radiance(480, 640, CV_32FC3, cv::Scalar(0.3, 0.3, 0.3));
  ColourSensor s;
  s.vignetting = 0.0f;
  s.jpeg_quality = 100;
  for (const float noise : {0.5f, 1.0f, 2.0f}) {
    s.noise_grey = noise;
    for (const bool mosaic : {false, true}) {
      s.mosaic = mosaic;
      const double measured = deviation(sense_colour(radiance, s, 7), 1);
      EXPECT_GT(measured, 0.7 * static_cast<double>(noise)) << noise << mosaic;
      EXPECT_LT(measured, 1.4 * static_cast<double>(noise) + 0.2) << noise << mosaic;
    }
  }
}

TEST(SenseColour, ColoursComeThroughTheMosaic) {
  const cv::Mat radiance(480, 640, CV_32FC3, cv::Scalar(0.5, 0.2, 0.05));  // RGB: orange
  ColourSensor s;
  s.vignetting = 0.0f;
  for (const bool mosaic : {false, true}) {
    s.mosaic = mosaic;
    const auto p = sense_colour(radiance, s, 7).at<cv::Vec3b>(240, 320);  // BGR
    EXPECT_GT(p[2], p[1] + 40);
    EXPECT_GT(p[1], p[0] + 40);
  }
}

TEST(SenseColour, VignettingDarkensCorners) {
  const cv::Mat radiance(480, 640, CV_32FC3, cv::Scalar(0.3, 0.3, 0.3));
  ColourSensor s;
  s.vignetting = 0.5f;
  const cv::Mat image = sense_colour(radiance, s, 7);
  EXPECT_GT(image.at<cv::Vec3b>(240, 320)[1], image.at<cv::Vec3b>(3, 3)[1] + 20);
}

TEST(SenseColour, SameSeedSameBytes) {
  const cv::Mat radiance(480, 640, CV_32FC3, cv::Scalar(0.3, 0.2, 0.3));
  const ColourSensor s;
  const auto different = [](const cv::Mat& a, const cv::Mat& b) {
    return std::memcmp(a.data, b.data, a.total() * 3) != 0;
  };
  EXPECT_FALSE(different(sense_colour(radiance, s, 1), sense_colour(radiance, s, 1)));
  EXPECT_TRUE(different(sense_colour(radiance, s, 1), sense_colour(radiance, s, 2)));
}

TEST(SenseDepth, StepsAreThoseOfTheDisparity) {
  DepthSensor s;
  s.warp_m = 0.0f;
  for (const float z : {0.7f, 1.0f, 1.3f}) {
    const cv::Mat depth = sense_depth(flat_wall(z), s, {}, 3);
    std::set<int> values;
    double sum = 0.0;
    for (int y = 0; y < 480; ++y) {
      for (int x = 0; x < 640; ++x) {
        ASSERT_GT(depth.at<std::uint16_t>(y, x), 0);
        values.insert(depth.at<std::uint16_t>(y, x));
        sum += depth.at<std::uint16_t>(y, x);
      }
    }
    EXPECT_NEAR(sum / depth.total(), 1000.0 * static_cast<double>(z), 2.5);
    ASSERT_GE(values.size(), 2u);
    const double step = static_cast<double>(*values.rbegin() - *values.begin()) /
                        static_cast<double>(values.size() - 1);
    const double expected = 1000.0 * static_cast<double>(z * z) / (575.0 * 0.075) / 8.0;
    EXPECT_NEAR(step, expected, 0.25 * expected + 0.3) << z;
  }
}

TEST(SenseDepth, LosesShadowsEdgesAndSteepSlopes) {
  IdealImages wall = flat_wall(1.0f);
  wall.shadow(cv::Rect(0, 0, 50, 50)) = 255;
  wall.cosine(cv::Rect(100, 0, 50, 50)) = 0.05;
  wall.depth_m(cv::Rect(300, 100, 100, 100)) = 0.8;
  DepthSensor s;
  s.edge_loss = 1.0f;
  const cv::Mat depth = sense_depth(wall, s, {}, 3);
  const auto missing = [&](const cv::Rect& r) {
    return 1.0 - static_cast<double>(cv::countNonZero(depth(r))) / r.area();
  };
  EXPECT_GT(missing({5, 5, 40, 40}), 0.99);
  EXPECT_GT(missing({105, 5, 40, 40}), 0.99);
  EXPECT_GT(missing({299, 110, 2, 80}), 0.9);
  EXPECT_LT(missing({400, 300, 100, 100}), 0.01);
}

}  // namespace
}  // namespace weft::synth
