// The long forms of reliability_test.cpp and lan_test.cpp, and their checks with the real set of
// processes, as ./weft test --slow runs them.
#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/imgproc.hpp>

#include "base/text_file.hpp"
#include "integration/hosts.hpp"
#include "integration/scenarios.hpp"
#include "integration/test_log.hpp"
#include "messages/rgbd.hpp"
#include "tools/weft/message.hpp"

namespace weft::test_hosts {
namespace {

const std::string kSample = WEFT_SOURCE_DIR "/logs/sample.lcm";

class ReliabilitySlow : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_hosts(); !why.empty()) GTEST_SKIP() << why;
    if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  }
};

/// A set of config/sets where it may lie anywhere; source: a process, or none; lines: more of the
/// set's own.
std::string shipped_set(const std::string& name, const std::string& source,
                        const std::string& lines = "") {
  auto text = read_text_file(WEFT_SOURCE_DIR "/config/sets/" + name + ".yaml");
  const auto replace = [&](const std::string& from, const std::string& to) {
    for (auto at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
      text.replace(at, from.size(), to);
  };
  replace("../stages/", WEFT_SOURCE_DIR "/config/stages/");
  if (!source.empty()) replace("processes:\n", "processes:\n" + source);
  if (!lines.empty()) replace("lan: false\n", lines);
  return text;
}

std::string parts_set(const std::string& source, const std::string& lines = "") {
  return shipped_set("parts-sift", source, lines);
}

std::string sample_camera(const std::string& more) {
  return "  - {name: eye, exec: weft-test-source, source: true, " + more +
         ", with: {log: " + kSample + "}}\n";
}

TEST_F(ReliabilitySlow, ThreeHundredFramesArriveCompleteOnThreeHosts) {
  three_hosts(small_set_on_three_hosts(300, 60'000, 30), small_set(""), 300, 0);
}

TEST_F(ReliabilitySlow, LostPacketsAreGapsOrMissingInputAndTheRestIsAnswered) {
  if (run_command({"nft", "--version"}).status != 0) GTEST_SKIP() << "no nft (nftables)";
  for (const int per_thousand : {1, 20})
    three_hosts(small_set_on_three_hosts(300, 60'000, 30), small_set(""), 300, per_thousand);
}

TEST_F(ReliabilitySlow, EachSmallProcessKilledTwentyTimes) {
  kill_in_turn(small_set("rate_hz: 10"), 20, 5);
}

TEST_F(ReliabilitySlow, EachProcessOfThePartsSetKilledTwentyTimes) {
  kill_in_turn(parts_set(sample_camera("rate_hz: 10")), 20, 5);
}

TEST_F(ReliabilitySlow, AStageThatHangsForFiveSecondsCatchesUp) { stop_and_go(5); }

TEST_F(ReliabilitySlow, TenThousandMessagesOfGarbageOnEveryChannel) {
  garbage(small_set("trigger: message"), test_stage::test_event(0, 5000).data, 10'000);
}

TEST_F(ReliabilitySlow, TenThousandMessagesOfGarbageOnEveryChannelOfPartsAndMap) {
  stage::LogReader log(kSample);
  stage::LogEvent event;
  while (log.next(event) && event.channel != "RGBD_FRAME") {
  }
  ASSERT_FALSE(event.data.empty());
  garbage(shipped_set("parts-map", sample_camera("trigger: message")), event.data, 10'000);
}

TEST_F(ReliabilitySlow, TwentyThousandFramesNeitherGrowNorSlow) {
  std::vector<std::vector<std::uint8_t>> messages;
  for (int i = 0; i < 100; ++i) messages.push_back(test_stage::test_event(i, 5000).data);
  soak(small_set(""), messages, 20'000);
}

/// The sample log at a quarter of its size in each direction.
TEST_F(ReliabilitySlow, TwentyThousandSmallImagesThroughThePartsSet) {
  constexpr int kShrink = 4;
  std::vector<std::vector<std::uint8_t>> messages;
  stage::LogReader log(kSample);
  for (stage::LogEvent event; log.next(event);) {
    if (event.channel != "RGBD_FRAME") continue;
    auto message = decode_message<weft::rgbd_frame_t>(event.data);
    ASSERT_TRUE(message);
    auto frame = messages::from_message(*message);
    for (cv::Mat* image : {&frame.colour, &frame.depth, &frame.mask}) {
      cv::Mat small;
      if (!image->empty())
        cv::resize(*image, small, {}, 1.0 / kShrink, 1.0 / kShrink, cv::INTER_NEAREST);
      *image = small;
    }
    frame.camera.width /= kShrink;
    frame.camera.height /= kShrink;
    for (double* value : {&frame.camera.fx, &frame.camera.fy, &frame.camera.cx, &frame.camera.cy})
      *value /= kShrink;
    messages::to_message(frame, {}, *message);
    messages.push_back(encode_message(*message));
  }
  ASSERT_FALSE(messages.empty());
  soak(parts_set(""), messages, 20'000);
}

TEST_F(ReliabilitySlow, ThePartsSetOnThreeHosts) {
  constexpr int kFrames = 300;
  auto set = parts_set(
      "  - {name: eye, exec: weft-test-source, source: true, host: alpha, camera: "
      "left, rate_hz: 3, with: {frames: 300, log: " +
          kSample + "}}\n",
      "lan: true\n");
  // The set has a line `exec: PROGRAM` for each stage.
  const std::string line = "    exec: weft-";
  for (auto at = set.find(line); at != std::string::npos;) {
    const bool describe = set.compare(at + line.size(), 8, "describe") == 0;
    const std::string more = std::string("    host: ") + (describe ? "beta" : "gamma") +
                             "\n    queue: 1000\n    deadline_ms: 60000\n";
    set.insert(at, more);
    at = set.find(line, at + more.size() + line.size());
  }
  three_hosts(set, parts_set(""), kFrames, 0);
}

}  // namespace
}  // namespace weft::test_hosts
