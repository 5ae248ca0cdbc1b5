#include "stage/in_process.hpp"

#include <gtest/gtest.h>

#include "fake_stage.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft::stage {
namespace {

using namespace fake;

/// RGBD_FRAME to FOREGROUND.
std::shared_ptr<Stage> segmenter() {
  Interface interface;
  interface.name = "foreground";
  interface.settings_hash = 17;
  interface.inputs = {port<rgbd_frame_t>("RGBD_FRAME")};
  interface.outputs = {port<foreground_t>("FOREGROUND")};
  return std::make_shared<FakeStage>(interface, [](const Inputs& in, Outputs& out) {
    if (in.header().seq == 3) throw InvalidInput("frame 3 is bad");
    out.at<foreground_t>("FOREGROUND").garment_px = in.get<rgbd_frame_t>("RGBD_FRAME").data_size;
  });
}

struct Published {
  std::string channel;
  Bytes bytes;
  bool operator==(const Published&) const = default;
};

std::vector<Published> run_set(int frames) {
  InProcess set;
  std::vector<Published> log;
  set.observe([&](const std::string& channel, const Bytes& bytes) {
    log.push_back({channel, bytes});
  });
  // In the wrong order, and with a variant that runs beside the baseline.
  set.add(std::make_shared<FakeStage>(joiner()));
  set.add(std::make_shared<FakeStage>(joiner()), "joiner-b",
          {{"WORDS", "WORDS@b"}, {"GRASPS", "GRASPS@b"}});
  set.add(segmenter());
  for (int seq = 0; seq < frames; ++seq) set.inject("RGBD_FRAME", encode(frame(header(seq))));
  set.run();
  for (const auto& report : set.reports()) {
    EXPECT_EQ(report.waiting, 0u);
    EXPECT_EQ(report.counters.frames_in, frames);
    EXPECT_EQ(report.counters.gaps, 0);
  }
  return log;
}

TEST(InProcess, AnswersEveryFrameOfASet) {
  const auto log = run_set(6);
  std::map<std::string, int> count;
  for (const auto& [channel, bytes] : log) ++count[channel];
  EXPECT_EQ(count, (std::map<std::string, int>{{"RGBD_FRAME", 6},
                                               {"FOREGROUND", 6},
                                               {"WORDS", 6},
                                               {"WORDS@b", 6},
                                               {"GRASPS", 6},
                                               {"GRASPS@b", 6},
                                               {"STAGE_TIMING", 18}}));
  for (const auto& [channel, bytes] : log) {
    if (channel != "WORDS") continue;
    const auto words = decode<words_t>(bytes);
    EXPECT_EQ(words.status.code, words.header.seq == 3 ? status_t::MISSING_INPUT : status_t::OK);
    EXPECT_EQ(words.vocabulary_size, words.header.seq == 3 ? 0 : 20);
  }
}

TEST(InProcess, IsDeterministic) {
  auto a = run_set(5);
  auto b = run_set(5);
  const auto is_timing = [](const Published& p) { return p.channel == "STAGE_TIMING"; };
  std::erase_if(a, is_timing);
  std::erase_if(b, is_timing);
  EXPECT_EQ(a, b);
}

TEST(InProcess, JoinsPartsOverLongQueues) {
  InProcess set;
  std::map<std::string, int> count;
  set.observe([&](const std::string& channel, const Bytes&) { ++count[channel]; });
  set.add(segmenter());
  set.add(std::make_shared<FakeStage>(joiner()));
  const auto type = message_type<rgbd_frame_t>();
  for (int seq = 0; seq < 500; ++seq) {
    const auto whole = frame(header(seq), 1000);
    for (const auto& part : type.split(&whole, 400))
      set.inject("RGBD_FRAME", type.encode(part.get()));
  }
  set.run();
  EXPECT_EQ(count["WORDS"], 500);
  EXPECT_GT(count["RGBD_FRAME"], 1000);
}

TEST(InProcess, ReportsTimingAndStatus) {
  InProcess set;
  set.add(segmenter(), "fg", {{"FOREGROUND", "FOREGROUND@x"}});
  std::vector<stage_timing_t> timings;
  std::vector<stage_status_t> statuses;
  set.observe([&](const std::string& channel, const Bytes& bytes) {
    if (channel == "STAGE_TIMING") timings.push_back(decode<stage_timing_t>(bytes));
    if (channel == "STAGE_STATUS") statuses.push_back(decode<stage_status_t>(bytes));
  });
  for (int seq = 0; seq < 4; ++seq) set.inject("RGBD_FRAME", encode(frame(header(seq))));
  set.run();
  set.publish_status(stage_status_t::RUNNING);
  set.publish_status(stage_status_t::STOPPING);
  ASSERT_EQ(timings.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    const auto& t = timings[i];
    EXPECT_EQ(encode(t.header), encode(header(static_cast<std::int64_t>(i))));
    EXPECT_EQ(t.stage, "fg");
    EXPECT_EQ(t.status_code, i == 3 ? status_t::FAILED : status_t::OK);
    EXPECT_LE(t.received_utime, t.started_utime);
    EXPECT_LE(t.started_utime, t.finished_utime);
    EXPECT_LE(t.finished_utime, t.published_utime);
    EXPECT_GT(t.received_utime, 1'600'000'000'000'000);
    EXPECT_GE(t.cpu_us, 0);
    EXPECT_EQ(t.queue_length, 1);
    EXPECT_GT(t.output_bytes, 50);
  }
  ASSERT_EQ(statuses.size(), 2u);
  const auto& s = statuses[0];
  EXPECT_EQ(s.stage, "fg");
  EXPECT_EQ(s.pid, getpid());
  EXPECT_FALSE(s.host.empty());
  EXPECT_FALSE(s.build.empty());
  EXPECT_EQ(s.settings_hash, 17);
  EXPECT_EQ(s.frames_in, 4);
  EXPECT_EQ(s.frames_out, 3);
  EXPECT_EQ(s.frames_failed, 1);
  EXPECT_EQ(s.invalid_inputs, 1);
  EXPECT_NE(s.last_error.find("frame 3 is bad"), std::string::npos);
  EXPECT_GT(s.resident_bytes, 1'000'000);
  ASSERT_EQ(s.fingerprint_count, 2);
  EXPECT_EQ(s.fingerprints[0].direction, type_fingerprint_t::INPUT);
  EXPECT_EQ(s.fingerprints[0].channel, "RGBD_FRAME");
  EXPECT_EQ(s.fingerprints[0].type, "rgbd_frame_t");
  EXPECT_EQ(s.fingerprints[0].fingerprint, static_cast<std::int64_t>(rgbd_frame_t::getHash()));
  EXPECT_EQ(s.fingerprints[1].direction, type_fingerprint_t::OUTPUT);
  EXPECT_EQ(s.fingerprints[1].channel, "FOREGROUND@x");
  EXPECT_EQ(statuses[1].state, stage_status_t::STOPPING);
  EXPECT_EQ(statuses[1].header.seq, s.header.seq + 1);
}

TEST(InProcess, RefusesTwoOfOneName) {
  InProcess set;
  set.add(segmenter());
  EXPECT_THROW(set.add(segmenter()), Error);
}

}  // namespace
}  // namespace weft::stage
