#include "synth/coco.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "tools/synth/rle.hpp"

namespace weft::synth {
namespace {

TEST(Coco, RunLengthsAreThoseOfTheReference) {
  // By hand, from rleToString of COCO's maskApi.c.
  cv::Mat none(4, 3, CV_8UC1, cv::Scalar(0));
  EXPECT_EQ(encode_rle(none), "<");
  cv::Mat one = none.clone();
  one.at<std::uint8_t>(1, 1) = 1;
  EXPECT_EQ(encode_rle(one), "516");
  cv::Mat all(4, 3, CV_8UC1, cv::Scalar(255));
  EXPECT_EQ(encode_rle(all), "0<");
}

TEST(Coco, RunLengthsGiveTheMaskBack) {
  cv::RNG random(3);
  for (const int threshold : {10, 128, 250}) {
    cv::Mat noise(48, 64, CV_8UC1), mask;
    random.fill(noise, cv::RNG::UNIFORM, 0, 256);
    cv::threshold(noise, mask, threshold, 255, cv::THRESH_BINARY);
    cv::circle(mask, {40, 20}, 15, cv::Scalar(255), cv::FILLED);
    const cv::Mat back = test::decode_rle(encode_rle(mask), mask.rows, mask.cols);
    EXPECT_EQ(cv::countNonZero(mask != back), 0);
  }
}

TEST(Coco, AnnotationsAgreeWithTheLabels) {
  cv::Mat labels(100, 120, CV_8UC1, cv::Scalar(255));
  labels(cv::Rect(0, 0, 120, 10)).setTo(0);
  labels(cv::Rect(20, 30, 40, 25)).setTo(1);
  labels(cv::Rect(70, 80, 3, 3)).setTo(2);
  const auto list =
      coco_annotations(labels, {{1, "fold-2", "a"}, {2, "flat", "b"}, {255, "desk", "round"}}, 20);
  ASSERT_EQ(list.size(), 2u);  // nine pixels are too few
  EXPECT_EQ(list[0]["category_id"], 4);
  EXPECT_EQ(list[0]["area"], 1000);
  EXPECT_EQ(list[0]["bbox"], nlohmann::json({20, 30, 40, 25}));
  EXPECT_EQ(list[1]["category_id"], 7);
  EXPECT_EQ(list[1]["area"], 120 * 90 - 1009);
  EXPECT_EQ(list[1]["bbox"], nlohmann::json({0, 10, 120, 90}));
  const auto file = coco_file({{{"image", {{"file_name", "x.png"}}}, {"annotations", list}}}, "d");
  EXPECT_EQ(file["categories"].size(), 7u);
  EXPECT_EQ(file["annotations"][1]["id"], 2);
  EXPECT_EQ(file["annotations"][1]["image_id"], file["images"][0]["id"]);
  EXPECT_ANY_THROW(coco_annotations(labels, {{1, "knot", "a"}}, 20));
}

}  // namespace
}  // namespace weft::synth
