// tools/examples/best_parts.lua, a stage that shares nothing with the others but the .lcm files.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <map>

#include "base/text_file.hpp"
#include "integration/test_log.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/run_folder.hpp"
#include "weft/part_detections_t.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";
constexpr double kThreshold = 0.5;

TEST(Lua, AStageInAnotherLanguageKeepsTheContract) {
  if (run_command({"lua5.2", "-e", "require('lcm') require('socket')"}).status != 0)
    GTEST_SKIP() << "no lua5.2 with liblcm-lua and lua-socket";
  if (run_command({"unshare", "-n", "true"}).status != 0 &&
      run_command({"unshare", "-U", "-r", "-n", "true"}).status != 0)
    GTEST_SKIP() << "no network namespace is permitted here";
  const auto folder = fs::temp_directory_path() / ("weft-lua-" + std::to_string(getpid()));
  fs::create_directories(folder);
  constexpr int kFrames = 12;
  test_stage::write_test_log(folder / "in.lcm", kFrames, 10'000);
  write_text_file(folder / "set.yaml",
                  "sources: [RGBD_FRAME]\nprocesses:\n"
                  "  - {name: mask, exec: weft-test-stage, with: {kind: mask}}\n"
                  "  - {name: words, exec: weft-test-stage, with: {kind: words, fail_every: 5}}\n"
                  "  - {name: parts, exec: weft-test-stage, with: {kind: parts}}\n"
                  "  - {name: best, exec: " WEFT_SOURCE_DIR
                  "/tools/examples/best_parts.lua, with: {threshold: 0.5},\n"
                  "     map: {BEST_PARTS: \"PART_DETECTIONS@best\"}}\n");
  // --verify: a second run gives the same bytes.
  const auto result = run_command({kWeft, "replay", (folder / "in.lcm").string(), "--set",
                                   (folder / "set.yaml").string(), "--out",
                                   (folder / "out.lcm").string(), "--verify"});
  ASSERT_EQ(result.status, 0) << result.output;
  EXPECT_EQ(run_command({kWeft, "log", "check", (folder / "out.lcm").string()}).status, 0);
  std::map<std::int64_t, weft::part_detections_t> all, best;
  int timings = 0;
  stage::LogReader log((folder / "out.lcm").string());
  for (stage::LogEvent event; log.next(event);) {
    if (event.channel == "STAGE_TIMING") ++timings;
    if (event.channel.rfind("PART_DETECTIONS", 0) != 0) continue;
    const auto message = decode_message<weft::part_detections_t>(event.data);
    ASSERT_TRUE(message);
    (event.channel == "PART_DETECTIONS" ? all : best)[message->header.seq] = *message;
  }
  ASSERT_EQ(all.size(), kFrames);
  ASSERT_EQ(best.size(), kFrames);
  EXPECT_EQ(timings, 4 * kFrames);
  int kept = 0, left_out = 0;
  for (const auto& [seq, in] : all) {
    const auto& out = best.at(seq);
    EXPECT_EQ(out.header.utime, in.header.utime);
    EXPECT_EQ(out.header.camera, in.header.camera);
    if (seq % 5 == 0) {  // parts said MISSING_INPUT
      EXPECT_EQ(out.status.code, weft::status_t::MISSING_INPUT) << seq;
      EXPECT_EQ(out.status.text, "PART_DETECTIONS is MISSING_INPUT: " + in.status.text);
      EXPECT_EQ(out.detection_count, 0);
      continue;
    }
    ASSERT_EQ(in.detection_count, 1);
    if (in.detections[0].probability < kThreshold) {
      ++left_out;
      EXPECT_EQ(out.status.code, weft::status_t::NOTHING) << seq;
      EXPECT_EQ(out.detection_count, 0);
      continue;
    }
    ++kept;
    EXPECT_EQ(out.status.code, weft::status_t::OK) << seq;
    ASSERT_EQ(out.detection_count, 1);
    EXPECT_EQ(out.detections[0].part, in.detections[0].part);
    EXPECT_EQ(out.detections[0].probability, in.detections[0].probability);
    EXPECT_EQ(out.detections[0].corners_sensor[2][1], in.detections[0].corners_sensor[2][1]);
  }
  EXPECT_GT(kept, 0);
  EXPECT_GT(left_out, 0);
  if (!testing::Test::HasFailure()) fs::remove_all(folder);
}

}  // namespace
}  // namespace weft
