#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "fuzz/fuzz.hpp"
#include "rgbd/codec.hpp"
#include "rgbd/depth_code.hpp"

/// Codes of colour, depth and mask images.
namespace weft::fuzz {
namespace {

constexpr int kWidth = 48, kHeight = 36;

cv::Mat colour_image() {
  cv::Mat image(kHeight, kWidth, CV_8UC3);
  Random random(1);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const auto noise = static_cast<int>(random.below(9));
      image.at<cv::Vec3b>(v, u) = cv::Vec3b(static_cast<std::uint8_t>(4 * u + noise),
                                            static_cast<std::uint8_t>(5 * v + noise), 90);
    }
  }
  return image;
}

cv::Mat depth_image() {
  cv::Mat image(kHeight, kWidth, CV_16UC1);
  Random random(2);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const auto depth = 900 + 3 * u + 2 * v + static_cast<int>(random.below(3));
      image.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(random.below(20) ? depth : 0);
    }
  }
  return image;
}

cv::Mat mask_image() { return depth_image() > 980; }

/// CRC of ISO 3309, as PNG's chunks have it.
std::uint32_t crc(const std::uint8_t* data, std::size_t size) {
  std::uint32_t value = ~0u;
  for (std::size_t i = 0; i < size; ++i) {
    value ^= data[i];
    for (int bit = 0; bit < 8; ++bit) value = value >> 1 ^ (value & 1 ? 0xedb88320u : 0);
  }
  return ~value;
}

void repair_png(Bytes& bytes) {
  for (std::size_t at = 8; at + 12 <= bytes.size();) {
    std::size_t length = 0;
    for (std::size_t i = 0; i < 4; ++i) length = length << 8 | bytes[at + i];
    if (length > bytes.size() - at - 12) return;
    const std::uint32_t sum = crc(&bytes[at + 4], length + 4);
    for (std::size_t i = 0; i < 4; ++i) {
      bytes[at + 8 + length + i] = static_cast<std::uint8_t>(sum >> (24 - 8 * i));
    }
    at += length + 12;
  }
}

Target png(rgbd::PngKind kind, const cv::Mat& image) {
  return {{rgbd::encode_png(image, kind)},
          [kind](const Bytes& bytes) {
            rgbd::decode_png(bytes.data(), bytes.size(), kind, kWidth, kHeight, "x");
          },
          repair_png};
}

WEFT_FUZZ_TARGET(ColourPng) { return png(rgbd::PngKind::kColour, colour_image()); }
WEFT_FUZZ_TARGET(DepthPng) { return png(rgbd::PngKind::kDepth, depth_image()); }
WEFT_FUZZ_TARGET(MaskPng) { return png(rgbd::PngKind::kMask, mask_image()); }

WEFT_FUZZ_TARGET(ColourJpeg) {
  return {
      {rgbd::encode_colour_jpeg(colour_image(), 90), rgbd::encode_colour_jpeg(colour_image(), 20)},
      [](const Bytes& bytes) {
        rgbd::decode_colour_jpeg(bytes.data(), bytes.size(), kWidth, kHeight, "x");
      }};
}

WEFT_FUZZ_TARGET(ImageSize) {
  return {{rgbd::encode_colour_jpeg(colour_image(), 90),
           rgbd::encode_png(mask_image(), rgbd::PngKind::kMask)},
          [](const Bytes& bytes) {
            const cv::Size size = rgbd::image_size(bytes.data(), bytes.size(), "x");
            require(
                size.width >= 1 && size.width <= 8192 && size.height >= 1 && size.height <= 8192,
                "an image size out of range");
          }};
}

WEFT_FUZZ_TARGET(DepthPalette) {
  return {{rgbd::encode_depth_palette(depth_image()),
           rgbd::encode_depth_palette(cv::Mat::zeros(kHeight, kWidth, CV_16UC1))},
          [](const Bytes& bytes) {
            rgbd::decode_depth_palette(bytes.data(), bytes.size(), kWidth, kHeight, "x");
          }};
}

WEFT_FUZZ_TARGET(DepthRvl) {
  return {{rgbd::encode_depth_rvl(depth_image())}, [](const Bytes& bytes) {
            rgbd::decode_depth_rvl(bytes.data(), bytes.size(), kWidth, kHeight, "x");
          }};
}

}  // namespace
}  // namespace weft::fuzz
