#include "tools/weft/frame_content.hpp"

#include <gtest/gtest.h>

namespace weft {
namespace {

template <class Message>
BusMessage encoded(const std::string& channel, Message message, std::int8_t code) {
  message.status.code = code;
  if (code != status_t::OK) message.status.text = "for a reason";
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return {channel, bytes};
}

TEST(FrameContent, AnAnswerOfNothingHasNoContentAndIsNoProblem) {
  PlayedFrame frame;
  frame.outputs = {encoded("PROBABILITY_MAP", probability_map_t{}, status_t::NOTHING),
                   encoded("PART_DETECTIONS", part_detections_t{}, status_t::NOTHING)};
  const auto content = read_content(frame);
  EXPECT_TRUE(content.problems.empty()) << content.problems.front();
  EXPECT_FALSE(content.failed);
  EXPECT_FALSE(content.maps.has_value());
}

TEST(FrameContent, AMapWithoutAGridIsAProblem) {
  PlayedFrame frame;
  frame.outputs = {encoded("MAP", probability_map_t{}, status_t::OK)};
  const auto content = read_content(frame);
  ASSERT_EQ(content.problems.size(), 1u);
  EXPECT_NE(content.problems[0].find("grid size"), std::string::npos) << content.problems[0];
  EXPECT_TRUE(content.failed);
  EXPECT_FALSE(content.maps.has_value());
}

TEST(FrameContent, AFailureIsNamedWithItsChannel) {
  PlayedFrame frame;
  frame.outputs = {encoded("GRASPS", grasps_t{}, status_t::FAILED)};
  const auto content = read_content(frame);
  ASSERT_EQ(content.problems.size(), 1u);
  EXPECT_NE(content.problems[0].find("GRASPS"), std::string::npos);
  EXPECT_NE(content.problems[0].find("for a reason"), std::string::npos);
  EXPECT_TRUE(content.failed);
  EXPECT_FALSE(content.grasps.has_value());
}

}  // namespace
}  // namespace weft
