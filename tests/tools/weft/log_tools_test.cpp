#include "tools/weft/log_tools.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "base/error.hpp"
#include "base/random.hpp"
#include "integration/test_log.hpp"
#include "lib/stage/fake_stage.hpp"
#include "stage/telemetry.hpp"
#include "support/files.hpp"
#include "tools/weft/log_out.hpp"
#include "tools/weft/message.hpp"
#include "weft/part_detections_t.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using stage::LogEvent;
using stage::LogReader;
using stage::LogWriter;

std::vector<LogEvent> events_of(const std::string& file) {
  LogReader log(file);
  std::vector<LogEvent> events;
  for (LogEvent event; log.next(event);) events.push_back(event);
  EXPECT_TRUE(log.damage().empty()) << file;
  return events;
}

std::string key(const LogEvent& event) {
  return event.channel + std::to_string(event.timestamp_us) +
         std::string(event.data.begin(), event.data.end());
}

class LogTools : public testing::Test {
 protected:
  /// Ten frames a second from two cameras, with detections, timings and reports, as a robot's
  /// logger leaves them.
  void write_robot_log(const std::string& file, int frames, std::size_t bytes = 3000) const {
    LogWriter log(file);
    for (int seq = 0; seq < frames; ++seq) {
      const std::int64_t time = 5'000'000 + seq * 100'000;
      log.write(time, "RGBD_FRAME", test_stage::test_event(seq, bytes).data);
      auto header = stage::fake::header(seq, 3, "left");
      log.write(time + 10'000, "LEFT", encode_message(stage::fake::frame(header, 200)));
      auto found = stage::fake::message<part_detections_t>(header);
      found.detections.resize(2);
      found.detection_count = 2;
      found.detections[0].part = found.detections[1].part = "polo collar";
      if (seq % 5 == 0) found.status.code = status_t::NOTHING;
      log.write(time + 20'000, "PART_DETECTIONS", encode_message(found));
      weft::stage_timing_t timing{};
      timing.header = header;
      timing.stage = "refine";
      log.write(time + 20'001, stage::kTimingChannel, encode_message(timing));
      weft::stage_status_t status{};
      status.header.seq = seq;
      log.write(time + 30'000, stage::kStatusChannel, encode_message(status));
      log.write(time + 40'000, "JOYSTICK", std::vector<std::uint8_t>{1, 2, 3, 4, 5});
    }
    log.close();
  }
  std::string path(const std::string& name) const { return folder_ / name; }
  const MessageTypes& types_ = MessageTypes::built_in();
  const test::TemporaryFolder folder_;
};

TEST_F(LogTools, SurveysAHealthyLog) {
  write_robot_log(path("a.lcm"), 20);
  const auto survey = survey_log(path("a.lcm"), types_);
  EXPECT_TRUE(survey.healthy());
  EXPECT_EQ(survey.events, 120);
  EXPECT_NEAR(survey.seconds(), 1.94, 1e-9);
  const auto& found = survey.channels.at("PART_DETECTIONS");
  EXPECT_EQ(found.type, "part_detections_t");
  EXPECT_EQ(found.frames, 20);
  EXPECT_EQ(found.not_ok, 4);
  EXPECT_EQ(found.missing, 0);
  EXPECT_EQ(survey.channels.at("JOYSTICK").type, "");
  EXPECT_EQ(survey.sessions.size(), 2u);
  EXPECT_EQ(survey.sessions.at({"left", 3}).second, 19);
  EXPECT_EQ(survey.backward_steps + survey.number_jumps, 0);
}

TEST_F(LogTools, AnEmptyLogIsHealthy) {
  test::write_bytes(path("empty.lcm"), "");
  EXPECT_TRUE(survey_log(path("empty.lcm"), types_).healthy());
  EXPECT_EQ(repair_log(path("empty.lcm"), path("out.lcm"), types_).written, 0);
  EXPECT_EQ(fs::file_size(path("out.lcm")), 0u);
  EXPECT_EQ(splice_logs({path("empty.lcm"), path("empty.lcm")}, path("two.lcm")).written, 0);
  EXPECT_THROW(cut_log(path("empty.lcm"), path("c.lcm"), {}), Error);
  EXPECT_FALSE(fs::exists(path("c.lcm")));
}

TEST_F(LogTools, CountsGapsAndStepsBack) {
  write_robot_log(path("a.lcm"), 20);
  LogWriter log(path("b.lcm"));
  for (const auto& event : events_of(path("a.lcm"))) {
    const auto frame = stage::fake::decode<part_detections_t>(event.data).header.seq;
    if (event.channel == "PART_DETECTIONS" && (frame == 4 || frame == 5 || frame == 11)) continue;
    log.write(event.timestamp_us - (event.channel == "JOYSTICK" ? 35'000 : 0), event.channel,
              event.data);
  }
  log.close();
  const auto survey = survey_log(path("b.lcm"), types_);
  EXPECT_TRUE(survey.healthy()) << "gaps are not damage";
  EXPECT_EQ(survey.channels.at("PART_DETECTIONS").missing, 3);
  EXPECT_EQ(survey.channels.at("LEFT").missing, 0);
  EXPECT_EQ(survey.backward_steps, 20);
}

/// The check of the issue: 40 flipped bytes and a cut tail.
TEST_F(LogTools, RepairKeepsWhatIsIntact) {
  write_robot_log(path("a.lcm"), 60, 900);
  const auto whole = test::read_bytes(path("a.lcm"));
  const auto all = events_of(path("a.lcm"));
  std::vector<std::size_t> begins{0};
  for (const auto& event : all)
    begins.push_back(begins.back() + 28 + event.channel.size() + event.data.size());
  Random random(11);
  double least = 1;
  for (int round = 0; round < 60; ++round) {
    auto bad = whole;
    std::set<std::size_t> hit;
    const auto event_at = [&](std::size_t byte) {
      return static_cast<std::size_t>(std::upper_bound(begins.begin(), begins.end(), byte) -
                                      begins.begin()) -
             1;
    };
    for (int i = 0; i < 40; ++i) {
      // Every second one into a header, where it hurts most.
      auto at = static_cast<std::size_t>(random.bits() % bad.size());
      if (i % 2 == 0) at = begins[event_at(at)] + random.bits() % 28;
      bad[at] = static_cast<char>(bad[at] ^ static_cast<char>(1 + random.bits() % 255));
      hit.insert(event_at(at));
    }
    const auto cut = bad.size() - 1 - random.bits() % 2000;
    bad.resize(cut);
    for (auto i = event_at(cut); i < all.size(); ++i) hit.insert(i);
    test::write_bytes(path("bad.lcm"), bad);
    EXPECT_FALSE(survey_log(path("bad.lcm"), types_).healthy());
    const auto counts = repair_log(path("bad.lcm"), path("good.lcm"), types_);
    EXPECT_EQ(test::read_bytes(path("bad.lcm")), bad) << "the input was touched";
    const auto after = survey_log(path("good.lcm"), types_);
    EXPECT_EQ(after.problem_count, 0);
    std::set<std::string> kept;
    for (const auto& event : events_of(path("good.lcm"))) kept.insert(key(event));
    EXPECT_EQ(counts.written, after.events);
    std::size_t intact = 0, found = 0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (hit.contains(i)) continue;
      ++intact;
      found += kept.contains(key(all[i]));
    }
    least = std::min(least, static_cast<double>(found) / static_cast<double>(intact));
  }
  EXPECT_GE(least, 0.97);
  RecordProperty("least_share_kept", std::to_string(least));
}

TEST_F(LogTools, ALengthThatGrewCostsOneEvent) {
  write_robot_log(path("a.lcm"), 30);
  const auto whole = test::read_bytes(path("a.lcm"));
  const auto all = events_of(path("a.lcm"));
  std::size_t begin = 0;
  for (std::size_t i = 0; i < 60; ++i) begin += 28 + all[i].channel.size() + all[i].data.size();
  for (const int bit : {8, 12, 14, 15}) {  // of the length: up to 32 KB more than it is
    auto bad = whole;
    auto& byte = bad[begin + 27 - static_cast<std::size_t>(bit) / 8];
    byte = static_cast<char>(byte ^ (1 << (bit % 8)));
    test::write_bytes(path("bad.lcm"), bad);
    const auto counts = repair_log(path("bad.lcm"), path("good.lcm"), types_);
    EXPECT_EQ(counts.written, static_cast<std::int64_t>(all.size()) - 1) << "bit " << bit;
  }
}

/// Every bit of every header: sync word, number, timestamp and the two lengths.
TEST_F(LogTools, ABitFlippedInAHeaderCostsNoOtherEvent) {
  write_robot_log(path("robot.lcm"), 2, 300);
  // Of known types: one of an unknown type is only trusted with a sound event after it.
  filter_log(path("robot.lcm"), path("a.lcm"), {{}, {"JOYSTICK"}, ""});
  const auto whole = test::read_bytes(path("a.lcm"));
  const auto all = events_of(path("a.lcm"));
  std::size_t begin = 0;
  for (std::size_t hit = 0; hit < all.size(); ++hit) {
    for (std::size_t bit = 0; bit < 28 * 8; ++bit) {
      auto bad = whole;
      auto& byte = bad[begin + bit / 8];
      byte = static_cast<char>(byte ^ (1 << (bit % 8)));
      test::write_bytes(path("bad.lcm"), bad);
      std::vector<LogEvent> left;  // what repair_log writes, without its wait for the disk
      LogReader log(path("bad.lcm"));
      EventJudge judge(types_);
      for (LogEvent event; log.next(event);) {
        if (judge.fault(event).empty()) {
          left.push_back(event);
        } else {
          log.look_inside();
        }
      }
      const bool framing = bit / 8 < 4 || bit / 8 >= 20;
      // A number or a time has no right or wrong of its own, so its event is kept.
      ASSERT_EQ(left.size(), all.size() - (framing ? 1 : 0)) << "event " << hit << ", bit " << bit;
      ASSERT_NE(survey_log(path("bad.lcm"), types_).healthy(), framing) << hit << ", " << bit;
      for (std::size_t i = 0; i < left.size(); ++i) {
        const auto& original = all[i + (framing && i >= hit ? 1 : 0)];
        ASSERT_EQ(left[i].channel, original.channel) << "event " << hit << ", bit " << bit;
        ASSERT_EQ(left[i].data, original.data) << "event " << hit << ", bit " << bit;
      }
    }
    begin += 28 + all[hit].channel.size() + all[hit].data.size();
  }
}

/// With a hole of 256 MB between two halves of a log, and 75 MB of messages.
TEST_F(LogTools, MemoryDoesNotGrowWithTheLog) {
  write_robot_log(path("a.lcm"), 10);
  const auto half = test::read_bytes(path("a.lcm"));
  const auto big = path("big.lcm");
  test::write_bytes(big, half);
  const auto hole = std::int64_t{1} << 28;
  if (truncate(big.c_str(), static_cast<off_t>(half.size()) + hole) != 0)
    GTEST_SKIP() << "no sparse file of this size here";
  std::ofstream(big, std::ios::binary | std::ios::app) << half;
  const auto copies = path("copies.lcm");
  {
    LogWriter log(copies);
    const auto event = test_stage::test_event(1, 150'000);
    for (int i = 0; i < 500; ++i) log.write(i, "RGBD_FRAME", event.data);  // 75 MB
    log.close();
  }
  rusage before{}, after{};
  getrusage(RUSAGE_SELF, &before);
  const auto survey = survey_log(big, types_);
  EXPECT_EQ(survey.events, 120);
  EXPECT_EQ(survey.problem_count, 2) << "the hole, and the unknown message before it";
  EXPECT_EQ(survey.skipped_bytes, hole);
  EXPECT_EQ(repair_log(copies, path("out.lcm"), types_).written, 500);
  getrusage(RUSAGE_SELF, &after);
  EXPECT_LT(after.ru_maxrss - before.ru_maxrss, 8 * 1024) << "KB more than before";
}

TEST_F(LogTools, FiltersChannelsAndCameras) {
  write_robot_log(path("a.lcm"), 10);
  EXPECT_EQ(filter_log(path("a.lcm"), path("b.lcm"), {{"PART_.*", "LEFT"}, {}, ""}).written, 20);
  EXPECT_EQ(filter_log(path("a.lcm"), path("b.lcm"), {{}, {"STAGE_.*"}, ""}).written, 40);
  const auto counts = filter_log(path("a.lcm"), path("b.lcm"), {{}, {}, "left"});
  EXPECT_EQ(counts.written, 50) << "all but RGBD_FRAME, of the other camera";
  for (const auto& event : events_of(path("b.lcm"))) EXPECT_NE(event.channel, "RGBD_FRAME");
  const auto none = test::error_of([&] {
    filter_log(path("a.lcm"), path("c.lcm"), {{"PART"}, {}, ""});
  });
  EXPECT_NE(none.find("none of its events"), std::string::npos) << none;
  EXPECT_FALSE(fs::exists(path("c.lcm")));
  EXPECT_THROW(filter_log(path("a.lcm"), path("c.lcm"), {{"("}, {}, ""}), Error);
}

TEST_F(LogTools, FilterTakesTheNameOfARobotOffItsChannelsOrPutsOneOn) {
  write_robot_log(path("a.lcm"), 10);
  const auto filter = [&](const std::string& from, const std::string& to, const LogFilter& by) {
    return filter_log(path(from), path(to), by).written;
  };
  EXPECT_EQ(filter("a.lcm", "red.lcm", {{"LEFT"}, {}, "", "", "red"}), 10);
  for (const auto& event : events_of(path("red.lcm"))) EXPECT_EQ(event.channel, "red/LEFT");
  EXPECT_EQ(filter("red.lcm", "own.lcm", {{"LEFT"}, {}, "", "red", ""}), 10);
  for (const auto& event : events_of(path("own.lcm"))) EXPECT_EQ(event.channel, "LEFT");
  EXPECT_THROW(filter("red.lcm", "none.lcm", {{}, {}, "", "blue", ""}), Error);
  EXPECT_THROW(filter("red.lcm", "none.lcm", {{}, {}, "", "", "a/b"}), Error);
}

TEST_F(LogTools, CutsByTimeAndByFrames) {
  write_robot_log(path("a.lcm"), 20);
  LogRange range;
  range.from_s = 0.5;
  range.to_s = 1.0;
  EXPECT_EQ(cut_log(path("a.lcm"), path("b.lcm"), range).written, 30);
  for (const auto& event : events_of(path("b.lcm"))) {
    EXPECT_GE(event.timestamp_us, 5'500'000);
    EXPECT_LT(event.timestamp_us, 6'000'000);
  }
  range = {};
  range.from_frame = 17;
  EXPECT_EQ(cut_log(path("a.lcm"), path("b.lcm"), range).written, 16);
  range.to_frame = 17;
  const auto counts = cut_log(path("a.lcm"), path("b.lcm"), range);
  EXPECT_EQ(counts.written, 4) << "of both cameras; a report comes after the frame's last message";
  const auto survey = survey_log(path("b.lcm"), types_);
  EXPECT_EQ(survey.sessions.at({"left", 3}), (std::pair<std::int64_t, std::int64_t>{17, 17}));
  range.from_frame = 500;
  range.to_frame.reset();
  EXPECT_THROW(cut_log(path("a.lcm"), path("c.lcm"), range), Error);
  EXPECT_FALSE(fs::exists(path("c.lcm")));
}

TEST_F(LogTools, SpliceBringsTwoLossyRecordingsTogether) {
  write_robot_log(path("a.lcm"), 30);
  const auto all = events_of(path("a.lcm"));
  LogWriter left(path("left.lcm")), right(path("right.lcm"));
  Random random(3);
  for (const auto& event : all) {
    const auto luck = random.bits() % 5;  // each recorder loses some, never both the same
    if (luck != 0) left.write(event.timestamp_us, event.channel, event.data);
    if (luck != 1) right.write(event.timestamp_us + 700, event.channel, event.data);
  }
  left.close();
  right.close();
  const auto counts = splice_logs({path("left.lcm"), path("right.lcm")}, path("b.lcm"));
  EXPECT_EQ(counts.written, static_cast<std::int64_t>(all.size()));
  EXPECT_EQ(counts.written + counts.copies, counts.read);
  std::int64_t last = 0;
  std::vector<std::string> found, wanted;
  for (const auto& event : events_of(path("b.lcm"))) {
    EXPECT_GE(event.timestamp_us, last);
    last = event.timestamp_us;
    found.emplace_back(event.data.begin(), event.data.end());
  }
  for (const auto& event : all) wanted.emplace_back(event.data.begin(), event.data.end());
  std::sort(found.begin(), found.end());
  std::sort(wanted.begin(), wanted.end());
  EXPECT_TRUE(found == wanted) << "the joystick's equal messages are all there, too";
}

TEST_F(LogTools, NeverWritesToItsInput) {
  write_robot_log(path("a.lcm"), 3);
  const auto before = test::read_bytes(path("a.lcm"));
  fs::create_symlink(path("a.lcm"), path("link.lcm"));
  fs::create_hard_link(path("a.lcm"), path("hard.lcm"));
  for (const std::string out : {"a.lcm", "link.lcm", "hard.lcm", "./a.lcm"}) {
    const auto text = test::error_of([&] { repair_log(path("a.lcm"), path(out), types_); });
    EXPECT_NE(text.find("never changed"), std::string::npos) << text;
    EXPECT_THROW(splice_logs({path("a.lcm")}, path(out)), Error);
  }
  EXPECT_EQ(test::read_bytes(path("a.lcm")), before);
  // A full disk, or any other error on the way, leaves neither a part nor a half.
  { LogOut(path("half.lcm"), {}).write(0, "A", {1}); }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.string()), {}), 3);
}

}  // namespace
}  // namespace weft
