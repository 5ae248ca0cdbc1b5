#include "messages/rgbd.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>

#include "base/random.hpp"
#include "stage/stage.hpp"
#include "support/files.hpp"

namespace weft::messages {
namespace {

using Message = rgbd_frame_t;

/// noise: how hard to compress, 0 to 255.
rgbd::RgbdFrame make_frame(int width, int height, int noise, std::uint64_t seed) {
  Random random(seed);
  rgbd::RgbdFrame frame;
  frame.source = "scene 7";
  frame.camera = {width, height, 525.0, 525.5, 0.5 * width, 0.5 * height};
  frame.depth_unit_m = 0.0005;
  frame.colour.create(height, width, CV_8UC3);
  frame.depth.create(height, width, CV_16UC1);
  frame.mask.create(height, width, CV_8UC1);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const auto shade = [&] {
        return static_cast<std::uint8_t>((u / 8 + v / 8) % 2 * 20 + 100 +
                                         random.below(static_cast<std::uint64_t>(noise) + 1) / 2);
      };
      frame.colour.at<cv::Vec3b>(v, u) = {shade(), shade(), shade()};
      frame.depth.at<std::uint16_t>(v, u) =
          static_cast<std::uint16_t>(random.below(40) ? 1000 + u / 4 + v / 3 + random.below(2) : 0);
      frame.mask.at<std::uint8_t>(v, u) = u > width / 3 && v > height / 3 ? 255 : 0;
    }
  }
  return frame;
}

void expect_same(const cv::Mat& a, const cv::Mat& b) {
  ASSERT_EQ(a.type(), b.type());
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(0, std::memcmp(a.data, b.data, a.total() * a.elemSize()));
}

Message message_of(const rgbd::RgbdFrame& frame, const FrameEncoding& encoding = {}) {
  Message message;
  to_message(frame, encoding, message);
  return message;
}

TEST(RgbdMessage, EveryEncodingBringsTheFrameBack) {
  const rgbd::RgbdFrame frame = make_frame(64, 48, 20, 1);
  using E = FrameEncoding;
  for (const auto colour : {E::Colour::kJpeg, E::Colour::kPng}) {
    for (const auto depth : {E::Depth::kPalette, E::Depth::kPng16, E::Depth::kRvl}) {
      const Message message = message_of(frame, {colour, depth});
      const rgbd::RgbdFrame back = from_message(message);
      EXPECT_EQ(back.camera, frame.camera);
      EXPECT_EQ(back.source, frame.source);
      EXPECT_EQ(back.depth_unit_m, frame.depth_unit_m);
      expect_same(back.depth, frame.depth);
      expect_same(back.mask, frame.mask);
      if (colour == E::Colour::kPng) expect_same(back.colour, frame.colour);
      EXPECT_EQ(back.colour.size(), frame.colour.size());
    }
  }
}

TEST(RgbdMessage, OnlyTheAskedForPlanesAreDecoded) {
  const Message message = message_of(make_frame(64, 48, 20, 1));
  const rgbd::RgbdFrame back =
      from_message(message, {.colour = false, .depth = true, .mask = false});
  EXPECT_TRUE(back.colour.empty());
  EXPECT_FALSE(back.depth.empty());
  EXPECT_TRUE(back.mask.empty());
}

TEST(RgbdMessage, JpegQualityFallsUntilTheFrameFitsOneMessage) {
  const auto fits = [](const Message& m) {
    return static_cast<std::size_t>(m.getEncodedSize()) <= stage::kMaxMessageBytes;
  };
  const Message easy = message_of(make_frame(640, 480, 10, 2));
  const Message hard = message_of(make_frame(640, 480, 140, 2));
  const Message hopeless = message_of(make_frame(1280, 720, 250, 2));
  EXPECT_TRUE(fits(easy));
  EXPECT_TRUE(fits(hard));
  EXPECT_FALSE(fits(hopeless));
  const Message too_large = message_of(make_frame(640, 480, 140, 2), {.min_jpeg_quality = 95});
  EXPECT_FALSE(fits(too_large));  // the test would not say anything otherwise
  // What travels in parts anyway loses nothing.
  EXPECT_EQ(hopeless.colour_size,
            message_of(make_frame(1280, 720, 250, 2), {.min_jpeg_quality = 95}).colour_size);
}

TEST(RgbdMessage, PartsPutTogetherAreTheFrame) {
  const rgbd::RgbdFrame frame = make_frame(1280, 720, 250, 3);
  const Message whole = message_of(frame);
  const stage::MessageType type = stage::message_type<Message>();
  const auto parts = type.split(&whole, stage::kMaxMessageBytes);
  ASSERT_GT(parts.size(), 1u);
  std::vector<std::shared_ptr<void>> received;
  for (const auto& part : parts) {
    const auto bytes = type.encode(part.get());
    EXPECT_LE(bytes.size(), stage::kMaxMessageBytes);
    received.push_back(type.decode(bytes.data(), static_cast<int>(bytes.size())));
    EXPECT_THROW(from_message(*static_cast<const Message*>(part.get())), stage::InvalidInput);
  }
  const auto joined = type.join(received);
  expect_same(from_message(*static_cast<const Message*>(joined.get())).depth, frame.depth);
}

TEST(RgbdMessage, ImpossibleContentIsInvalidInput) {
  const Message good = message_of(make_frame(64, 48, 20, 4));
  const std::pair<const char*, std::function<void(Message&)>> lies[] = {
      {"image size 0x48", [](Message& m) { m.camera_model.width = 0; }},
      {"are more than", [](Message& m) { m.camera_model.width = m.camera_model.height = 8192; }},
      {"not 65x48", [](Message& m) { m.camera_model.width = 65; }},
      {"focal lengths fx=nan", [](Message& m) { m.camera_model.fx = std::nan(""); }},
      {"depth_unit_m = 0", [](Message& m) { m.depth_unit_m = 0; }},
      {"depth_unit_m = nan", [](Message& m) { m.depth_unit_m = std::nan(""); }},
      {"part 0 of 2", [](Message& m) { m.part_count = 2; }},
      {"do not add up", [](Message& m) { m.colour_size += 1; }},
      {"do not add up", [](Message& m) { m.mask_size = -m.mask_size; }},
      {"do not add up", [](Message& m) { m.depth_size = 2147483647; }},
      {"do not add up", [](Message& m) { m.data.pop_back(); }},
      {"colour of encoding 0 has", [](Message& m) { m.colour_encoding = 0; }},
      {"unknown colour encoding 9", [](Message& m) { m.colour_encoding = 9; }},
      {"unknown depth encoding -1", [](Message& m) { m.depth_encoding = -1; }},
      {"unknown mask encoding 2", [](Message& m) { m.mask_encoding = 2; }},
      {"not a PNG", [](Message& m) { m.colour_encoding = Message::COLOUR_PNG; }},
      {"damaged depth image", [](Message& m) { m.depth_encoding = Message::DEPTH_RVL; }},
      {"damaged depth image",
       [](Message& m) { m.data[static_cast<std::size_t>(m.colour_size) + 2] ^= 255; }},
      {"JPEG", [](Message& m) { m.data[0] = 0; }},
      {"has no colour",
       [](Message& m) {
         m.data.erase(m.data.begin(), m.data.begin() + m.colour_size);
         m.colour_size = m.colour_encoding = 0;
       }},
  };
  for (const auto& [reason, lie] : lies) {
    Message message = good;
    lie(message);
    std::string text;
    try {
      from_message(message);
    } catch (const stage::InvalidInput& e) {
      text = e.what();
    }
    EXPECT_EQ(text.find("RGBD_FRAME"), 0u) << reason << ": " << text;
    EXPECT_NE(text.find(reason), std::string::npos) << reason << ": " << text;
  }
}

TEST(RgbdMessage, FramesThatDoNotFitTheirCameraAreErrors) {
  rgbd::RgbdFrame frame = make_frame(64, 48, 20, 5);
  frame.camera.width = 63;
  EXPECT_NE(test::error_of([&] { message_of(frame); }).find("depth image"), std::string::npos);
  frame = make_frame(64, 48, 20, 5);
  frame.mask = cv::Mat(10, 10, CV_8UC1, cv::Scalar(0));
  EXPECT_NE(test::error_of([&] { message_of(frame); }).find("mask image"), std::string::npos);
}

}  // namespace
}  // namespace weft::messages
