#include "rgbd/codec.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>

#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::rgbd {
namespace {

using test::error_of;
using Bytes = std::vector<std::uint8_t>;

cv::Mat picture(int type, std::uint64_t seed) {
  Random random(seed);
  cv::Mat image(30, 40, type);
  for (int v = 0; v < 30; ++v) {
    for (int u = 0; u < 40; ++u) {
      const auto shade = static_cast<std::uint8_t>(100 + 2 * u + 2 * v + random.below(4));
      if (type == CV_8UC3) image.at<cv::Vec3b>(v, u) = {shade, 90, 30};
      if (type == CV_16UC1) image.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(shade * 255);
      if (type == CV_8UC1) image.at<std::uint8_t>(v, u) = random.below(2) ? 255 : 0;
    }
  }
  return image;
}

constexpr std::pair<PngKind, int> kKinds[] = {
    {PngKind::kColour, CV_8UC3}, {PngKind::kDepth, CV_16UC1}, {PngKind::kMask, CV_8UC1}};

TEST(Codec, PngIsLossless) {
  for (const auto& [kind, type] : kKinds) {
    const cv::Mat image = picture(type, 1);
    const Bytes bytes = encode_png(image, kind);
    const cv::Mat back = decode_png(bytes.data(), bytes.size(), kind, 40, 30, "x");
    ASSERT_EQ(back.type(), type);
    EXPECT_EQ(0, std::memcmp(back.data, image.data, image.total() * image.elemSize()));
  }
}

TEST(Codec, JpegIsCloseAndTheCloserTheBetterItsQuality) {
  const cv::Mat image = picture(CV_8UC3, 2);
  std::size_t last_size = 0;
  for (const int quality : {50, 80, 95}) {
    const Bytes bytes = encode_colour_jpeg(image, quality);
    EXPECT_GT(bytes.size(), last_size);
    last_size = bytes.size();
    const cv::Mat back = decode_colour_jpeg(bytes.data(), bytes.size(), 40, 30, "x");
    int worst = 0;
    for (std::size_t i = 0; i < image.total() * 3; ++i)
      worst = std::max(worst, std::abs(image.data[i] - back.data[i]));
    EXPECT_LE(worst, quality == 95 ? 6 : 25);
  }
}

TEST(Codec, WhatTheBytesAreNotIsAnError) {
  const Bytes jpeg = encode_colour_jpeg(picture(CV_8UC3, 3), 90);
  const auto jpeg_error = [](Bytes bytes, int width, int height) {
    return error_of([&] { decode_colour_jpeg(bytes.data(), bytes.size(), width, height, "x"); });
  };
  EXPECT_EQ(jpeg_error(jpeg, 41, 30), "x: the image is 40x30 px, not 41x30");
  EXPECT_NE(jpeg_error({}, 40, 30).find("does not start as one"), std::string::npos);
  EXPECT_NE(jpeg_error({jpeg.begin(), jpeg.end() - 5}, 40, 30).find("its end is missing"),
            std::string::npos);
  EXPECT_NE(jpeg_error({0xff, 0xd8, 0xff, 0xd9}, 40, 30).find("damaged segments"),
            std::string::npos);
  for (const auto& [kind, type] : kKinds) {
    const Bytes png = encode_png(picture(type, 4), kind);
    const auto png_error = [&, k = kind](const Bytes& bytes, int width, int height) {
      return error_of([&] { decode_png(bytes.data(), bytes.size(), k, width, height, "x"); });
    };
    EXPECT_EQ(png_error(png, 40, 29), "x: the image is 40x30 px, not 40x29");
    EXPECT_EQ(png_error({png.begin() + 1, png.end()}, 40, 30), "x: not a PNG");
    EXPECT_NE(png_error({png.begin(), png.end() - 30}, 40, 30), "");
    for (const auto& [other, other_type] : kKinds) {
      if (other == kind) continue;
      EXPECT_NE(png_error(encode_png(picture(other_type, 5), other), 40, 30).find("not what was"),
                std::string::npos);
    }
  }
  cv::Mat grey = picture(CV_8UC1, 6);
  EXPECT_NE(error_of([&] { encode_png(grey, PngKind::kDepth); }), "");
  EXPECT_NE(error_of([&] { encode_colour_jpeg(grey, 90); }), "");
}

TEST(Codec, FlippedBitsNeverDoHarm) {
  Random random(7);
  const Bytes jpeg = encode_colour_jpeg(picture(CV_8UC3, 8), 90);
  int jpeg_errors = 0, png_errors = 0, png_runs = 0;
  for (int run = 0; run < 500; ++run) {
    Bytes damaged = jpeg;
    damaged[random.below(damaged.size())] ^= static_cast<std::uint8_t>(1 << random.below(8));
    jpeg_errors +=
        !error_of([&] { decode_colour_jpeg(damaged.data(), damaged.size(), 40, 30, "x"); }).empty();
  }
  for (const auto& [kind, type] : kKinds) {
    const Bytes png = encode_png(picture(type, 9), kind);
    for (int run = 0; run < 200; ++run, ++png_runs) {
      Bytes damaged = png;
      damaged[random.below(damaged.size())] ^= static_cast<std::uint8_t>(1 << random.below(8));
      png_errors += !error_of([&, k = kind] {
                       decode_png(damaged.data(), damaged.size(), k, 40, 30, "x");
                     }).empty();
    }
  }
  EXPECT_GT(jpeg_errors, 20);
  EXPECT_GT(png_errors, png_runs / 2);  // its pieces carry checksums
}

}  // namespace
}  // namespace weft::rgbd
