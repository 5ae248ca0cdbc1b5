#include "bovw/describe.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace weft::bovw {
namespace {

struct Scan {
  rgbd::RgbdFrame frame;
  cv::Mat mask;
};

// Noise on the left half of the garment, flat grey on its right.
Scan make_scan() {
  Scan scan;
  scan.frame.camera = {160, 120, 130.0, 130.0, 80.0, 60.0};
  scan.frame.colour = cv::Mat(120, 160, CV_8UC3, cv::Scalar(100, 100, 100));
  scan.frame.depth = cv::Mat(120, 160, CV_16UC1, cv::Scalar(900));
  scan.mask = cv::Mat(120, 160, CV_8UC1, cv::Scalar(0));
  Random random(1);
  for (int y = 20; y < 100; ++y) {
    for (int x = 10; x < 150; ++x) {
      scan.mask.at<std::uint8_t>(y, x) = 255;
      if (x < 80) {
        scan.frame.colour.at<cv::Vec3b>(y, x) =
            cv::Vec3b::all(static_cast<std::uint8_t>(random.below(256)));
      }
    }
  }
  return scan;
}

DescribeOptions sensor_view() {
  DescribeOptions options;
  options.view.rectified = false;
  return options;
}

TEST(Describe, CellsSayOutsideNoWordOrTheNearestWord) {
  const auto scan = make_scan();
  const auto options = sensor_view();
  const auto descriptor = descriptor::make_descriptor(options.descriptor);
  const auto described = describe_frame(scan.frame, scan.mask, nullptr, options, *descriptor, 1);
  EXPECT_EQ(described.view.width, 160);
  Random random(2);
  std::vector<std::uint8_t> samples;
  sample_descriptors(described.field, 50, random, samples);
  ASSERT_EQ(samples.size(), 50u * 128);
  KMeansOptions kmeans;
  kmeans.words = 8;
  const Vocabulary vocabulary("sift", 128, train_kmeans(samples, 128, kmeans, 1).centres,
                              options_hash(options), options_to_yaml(options));
  const auto words = quantise(described, "sift", vocabulary, 2);
  EXPECT_EQ(words.descriptor, "sift");
  EXPECT_EQ(words.vocabulary_hash, vocabulary.hash());
  EXPECT_EQ(words.vocabulary_size, 8);
  EXPECT_EQ(words.columns, described.field.grid.columns);
  EXPECT_EQ(words.origin_x, 6.0);
  std::size_t found = 0;
  for (int row = 0; row < words.rows; ++row) {
    for (int column = 0; column < words.columns; ++column) {
      const int x = 6 + 6 * column, y = 6 + 6 * row, word = words.at(column, row);
      if (!scan.mask.at<std::uint8_t>(y, x)) {
        EXPECT_EQ(word, WordGrid::kOutsideMask);
      } else if (x < 70) {
        ASSERT_GE(word, 0);
        ASSERT_LT(word, 8);
        std::vector<std::int16_t> alone(1);
        vocabulary.assign(std::span(described.field.values).subspan(found * 128, 128), alone);
        EXPECT_EQ(word, alone[0]);
      } else if (x > 95) {
        EXPECT_EQ(word, WordGrid::kNoWord);
      }
      if (word >= 0) ++found;
    }
  }
  EXPECT_EQ(found, described.field.points.size());
}

TEST(Describe, SamplesAreDistinctDescriptorsOfTheField) {
  descriptor::DescriptorField field;
  field.dimension = 1;
  for (int i = 0; i < 100; ++i) {
    field.points.push_back(i);
    field.values.push_back(static_cast<std::uint8_t>(i));
  }
  Random random(3);
  std::vector<std::uint8_t> samples;
  sample_descriptors(field, 30, random, samples);
  ASSERT_EQ(samples.size(), 30u);
  for (std::size_t i = 1; i < samples.size(); ++i) EXPECT_LT(samples[i - 1], samples[i]);
  sample_descriptors(field, 1000, random, samples);
  EXPECT_EQ(samples.size(), 130u);
}

TEST(Describe, RefusesAVocabularyOfOtherSettings) {
  auto options = sensor_view();
  const Vocabulary vocabulary("sift", 1, {0, 1}, options_hash(options), options_to_yaml(options));
  EXPECT_NO_THROW(check_settings(vocabulary, options));
  options.descriptor.sift.bin_px = 5;
  try {
    check_settings(vocabulary, options);
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("bin_px: 4"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("bin_px: 5"), std::string::npos) << e.what();
  }
  Described described;
  described.field.dimension = 2;
  EXPECT_THROW(quantise(described, "sift", vocabulary, 1), Error);
  described.field.dimension = 1;
  EXPECT_THROW(quantise(described, "fpfh", vocabulary, 1), Error);
}

}  // namespace
}  // namespace weft::bovw
