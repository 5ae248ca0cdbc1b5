#include "rgbd/depth_code.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>

#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::rgbd {
namespace {

using test::error_of;

struct Code {
  const char* name;
  std::vector<std::uint8_t> (*encode)(const cv::Mat&);
  cv::Mat (*decode)(const std::uint8_t*, std::size_t, int, int, const std::string&);
};

class DepthCodes : public testing::TestWithParam<Code> {
 protected:
  std::string decode_error(const std::vector<std::uint8_t>& bytes, int width, int height) {
    return error_of([&] { GetParam().decode(bytes.data(), bytes.size(), width, height, "here"); });
  }
};

cv::Mat filled(int width, int height, const std::function<int(int u, int v)>& value) {
  cv::Mat image(height, width, CV_16UC1);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      image.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(value(u, v));
  return image;
}

/// A tilted, wavy surface in the steps of a disparity sensor, with noise and holes.
cv::Mat sensor_like(int width, int height, std::uint64_t seed) {
  Random random(seed);
  return filled(width, height, [&](int u, int v) {
    if (random.below(50) == 0 || (u > width / 2 && u < width / 2 + 9)) return 0;
    const double z = 900.0 + 0.4 * u + 0.2 * v + 30.0 * ((u / 40 + v / 30) % 2);
    const int disparity = static_cast<int>(575.0 * 75.0 * 8.0 / z + 0.4 * random.normal());
    return static_cast<int>(575.0 * 75.0 * 8.0 / disparity);
  });
}

TEST_P(DepthCodes, RoundTripIsLossless) {
  Random random(2);
  const std::pair<const char*, cv::Mat> images[] = {
      {"1x1 missing", filled(1, 1, [](int, int) { return 0; })},
      {"1x1", filled(1, 1, [](int, int) { return 65535; })},
      {"one column", filled(1, 7, [](int, int v) { return v * 9000; })},
      {"one row", filled(9, 1, [](int u, int) { return u * 7000; })},
      {"all missing", filled(64, 48, [](int, int) { return 0; })},
      {"constant", filled(64, 48, [](int, int) { return 777; })},
      {"ramp", filled(300, 219, [](int u, int v) { return u * 218 + v; })},
      {"noise", filled(123, 77, [&](int, int) { return static_cast<int>(random.below(65536)); })},
      {"sparse", filled(123, 77, [&](int, int) { return random.below(9) ? 0 : 1000; })},
      {"checkerboard", filled(64, 49, [](int u, int v) { return (u + v) % 2 ? 1 : 65535; })},
      {"sensor", sensor_like(320, 240, 3)},
      {"part of a larger image", sensor_like(320, 240, 4)(cv::Rect(10, 20, 100, 101))},
  };
  for (const auto& [name, image] : images) {
    SCOPED_TRACE(name);
    const auto bytes = GetParam().encode(image);
    const cv::Mat back =
        GetParam().decode(bytes.data(), bytes.size(), image.cols, image.rows, "here");
    for (int v = 0; v < image.rows; ++v)
      ASSERT_EQ(0, std::memcmp(back.ptr(v), image.ptr(v), image.cols * sizeof(std::uint16_t)));
  }
}

TEST_P(DepthCodes, TruncationIsAnError) {
  const cv::Mat image = sensor_like(64, 48, 5);
  const auto bytes = GetParam().encode(image);
  for (std::size_t size = 0; size < bytes.size(); size += 1 + size / 50) {
    EXPECT_EQ(0u, decode_error({bytes.begin(), bytes.begin() + static_cast<long>(size)}, 64, 48)
                      .find("here: damaged depth image"))
        << size;
  }
}

TEST_P(DepthCodes, AnotherSizeOrSomethingBehindIsAnError) {
  const auto bytes = GetParam().encode(sensor_like(64, 48, 6));
  for (const auto& [width, height] : {std::pair{64, 47}, {64, 49}, {63, 48}, {65, 48}, {1, 1}})
    EXPECT_NE(decode_error(bytes, width, height), "") << width << "x" << height;
  auto longer = bytes;
  longer.insert(longer.end(), 4, 0);
  EXPECT_NE(decode_error(longer, 64, 48), "");
}

TEST_P(DepthCodes, FlippedBitsNeverDoHarm) {
  const auto bytes = GetParam().encode(sensor_like(64, 48, 7));
  Random random(8);
  int errors = 0;
  for (int run = 0; run < 3000; ++run) {
    auto damaged = bytes;
    // Early bytes hold the tables, which decide how everything else is read.
    const std::size_t reach = run % 2 ? damaged.size() : damaged.size() / 8;
    damaged[random.below(reach)] ^= static_cast<std::uint8_t>(1 << random.below(8));
    if (run % 3 == 0) damaged[random.below(reach)] = static_cast<std::uint8_t>(random.below(256));
    if (!decode_error(damaged, 64, 48).empty()) ++errors;
  }
  EXPECT_GT(errors, 1000);
}

TEST_P(DepthCodes, NoiseIsAnError) {
  Random random(9);
  for (int run = 0; run < 2000; ++run) {
    std::vector<std::uint8_t> bytes(random.below(300));
    for (auto& byte : bytes)
      byte = static_cast<std::uint8_t>(random.below(random.below(2) ? 256 : 4));
    EXPECT_NE(decode_error(bytes, 640, 480), "");
  }
}

INSTANTIATE_TEST_SUITE_P(All, DepthCodes,
                         testing::Values(Code{"palette", encode_depth_palette,
                                              decode_depth_palette},
                                         Code{"rvl", encode_depth_rvl, decode_depth_rvl}),
                         [](const auto& each) { return std::string(each.param.name); });

TEST(DepthCode, RvlIsThatOfThePaper) {
  // By hand: no zeros, 3 values, +5, -2, +9 (zigzag 10, 3, 18): nibbles 0, 3, then 10 = 8|2, 1;
  // 3; 18 = 8|2, 2. Eight nibbles to a little-endian word, the first topmost: 0 3 a 1 3 a 2.
  const cv::Mat image = filled(3, 1, [](int u, int) { return std::array{5, 3, 12}[u]; });
  EXPECT_EQ(encode_depth_rvl(image), (std::vector<std::uint8_t>{0x20, 0x3a, 0xa1, 0x03}));
}

TEST(DepthCode, ThePaletteCodeIsSmallOnSensorDepth) {
  const cv::Mat image = sensor_like(640, 480, 10);
  const auto palette = encode_depth_palette(image), rvl = encode_depth_rvl(image);
  EXPECT_LT(palette.size() * 3, rvl.size());
}

TEST(DepthCode, OtherImagesAreErrors) {
  EXPECT_NE(error_of([] { encode_depth_palette(cv::Mat(4, 4, CV_8UC1, cv::Scalar(0))); }), "");
  EXPECT_NE(error_of([] { encode_depth_rvl(cv::Mat()); }), "");
}

}  // namespace
}  // namespace weft::rgbd
