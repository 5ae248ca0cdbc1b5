#include "tools/weft/timing_report.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/text_file.hpp"
#include "stage/log.hpp"
#include "stage/telemetry.hpp"
#include "support/files.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/message.hpp"
#include "weft/status_t.hpp"

namespace weft {
namespace {

constexpr std::int64_t kStart = 1'700'000'000'000'000;

weft::stage_timing_t timing(const std::string& stage, std::int64_t seq, int received, int started,
                            int finished, int published) {
  weft::stage_timing_t t{};
  t.header = {0, "left", 1, seq, "camera"};
  t.stage = stage;
  t.host = stage == "grasp" ? "robot-2" : "robot-1";
  t.received_utime = kStart + received * 1000;
  t.started_utime = kStart + started * 1000;
  t.finished_utime = kStart + finished * 1000;
  t.published_utime = kStart + published * 1000;
  t.cpu_us = (finished - started) * 500;
  return t;
}

weft::stage_status_t ports(const std::string& stage, const std::vector<std::string>& inputs,
                           const std::vector<std::string>& outputs) {
  weft::stage_status_t status{};
  status.stage = stage;
  for (const auto& each : inputs)
    status.fingerprints.push_back({weft::type_fingerprint_t::INPUT, each, "", 0});
  for (const auto& each : outputs)
    status.fingerprints.push_back({weft::type_fingerprint_t::OUTPUT, each, "", 0});
  status.fingerprint_count = static_cast<std::int32_t>(status.fingerprints.size());
  return status;
}

/// mask feeds words, words feeds parts; clock runs beside them and feeds nobody.
TimingCollector collected(bool with_ports) {
  TimingCollector timing_of;
  for (int i = 0; i < 4; ++i) {
    const int t = 100 * i;
    timing_of.add(timing("mask", i, t, t + 2, t + 12, t + 13));
    timing_of.add(timing("clock", i, t, t + 1, t + 40, t + 41));
    timing_of.add(timing("words", i, t + 14, t + 14, t + 44, t + 45));
    timing_of.add(timing("grasp", i, t + 47, t + 50, t + 60, t + 61));
  }
  if (with_ports) {
    timing_of.add(ports("mask", {"RGBD_FRAME"}, {"FOREGROUND"}));
    timing_of.add(ports("clock", {"RGBD_FRAME"}, {"TICK"}));
    timing_of.add(ports("words", {"FOREGROUND", "RGBD_FRAME"}, {"WORDS"}));
    timing_of.add(ports("grasp", {"WORDS"}, {"GRASPS"}));
  }
  return timing_of;
}

std::vector<std::string> stages_of(const TimingReport& report, const CriticalPath& path) {
  std::vector<std::string> names;
  for (const auto& step : path.steps)
    names.push_back(report.stages[report.spans[step.span].stage].stage);
  return names;
}

TEST(TimingReport, FollowsTheCriticalPath) {
  for (const bool with_ports : {false, true}) {
    const auto report = collected(with_ports).report();
    ASSERT_EQ(report.critical_paths.size(), 4u);
    for (const auto& path : report.critical_paths) {
      EXPECT_EQ(stages_of(report, path), (std::vector<std::string>{"mask", "words", "grasp"}));
      EXPECT_NEAR(path.total, 61, 1e-9);
      double sum = 0;
      for (const auto& step : path.steps) {
        const auto& span = report.spans[step.span];
        sum += step.transport + span.finished - span.received + step.publish;
      }
      EXPECT_NEAR(sum, path.total, 1e-9) << "every millisecond is somebody's";
    }
    EXPECT_EQ(report.stages[1].stage, "clock");
    EXPECT_EQ(report.stages[1].critical_frames, 0u);
    EXPECT_NEAR(report.stages[3].critical_ms, 2 + 14, 1e-9);
    EXPECT_NEAR(report.transport.max, 2, 1e-9);
  }
}

/// Only the channels tell that words does not wait for a clock that happens to answer before it.
TEST(TimingReport, ChannelsTellWhoWaitsForWhom) {
  TimingCollector timing_of;
  timing_of.add(timing("mask", 0, 0, 0, 10, 10));
  timing_of.add(timing("clock", 0, 0, 0, 19, 19));
  timing_of.add(timing("words", 0, 20, 20, 30, 30));
  EXPECT_EQ(stages_of(timing_of.report(), timing_of.report().critical_paths[0]),
            (std::vector<std::string>{"clock", "words"}));
  timing_of.add(ports("mask", {"RGBD_FRAME"}, {"FOREGROUND"}));
  timing_of.add(ports("clock", {"RGBD_FRAME"}, {"TICK"}));
  timing_of.add(ports("words", {"FOREGROUND"}, {"WORDS"}));
  const auto report = timing_of.report();
  EXPECT_EQ(stages_of(report, report.critical_paths[0]),
            (std::vector<std::string>{"mask", "words"}));
  EXPECT_NEAR(report.critical_paths[0].steps[1].transport, 10, 1e-9);
}

TEST(TimingReport, AMessageMayArriveBeforeItsSenderIsDoneSending) {
  TimingCollector timing_of;
  timing_of.add(timing("mask", 0, 0, 0, 10, 25));
  timing_of.add(timing("words", 0, 12, 12, 30, 31));
  const auto report = timing_of.report();
  ASSERT_EQ(report.critical_paths[0].steps.size(), 2u);
  EXPECT_NEAR(report.critical_paths[0].steps[0].publish, 2, 1e-9);
  EXPECT_NEAR(report.critical_paths[0].steps[1].transport, 0, 1e-9);
}

TEST(TimingReport, CountsLossesAndGaps) {
  TimingCollector timing_of;
  for (const int seq : {0, 1, 2, 5, 6}) {
    auto each = timing("mask", seq, seq * 10, seq * 10, seq * 10 + 5, seq * 10 + 6);
    each.status_code = seq == 1   ? weft::status_t::FAILED
                       : seq == 2 ? weft::status_t::DROPPED
                       : seq == 5 ? weft::status_t::MISSING_INPUT
                                  : weft::status_t::NOTHING;
    timing_of.add(each);
    timing_of.add(each);  // a repeat
  }
  const auto report = timing_of.report();
  const auto& mask = report.stages.at(0);
  EXPECT_EQ(mask.frames, 5u);
  EXPECT_EQ(mask.failed, 1u);
  EXPECT_EQ(mask.dropped, 1u);
  EXPECT_EQ(mask.missing_input, 1u);
  EXPECT_EQ(mask.gaps, 2);
  EXPECT_NEAR(mask.publish.p50, 1, 1e-9);
  EXPECT_NEAR(mask.cpu.p50, 2.5, 1e-9);
  const auto json = nlohmann::json::parse(to_json(report));
  EXPECT_EQ(json["stages"]["mask"]["gaps"], 2);
  EXPECT_NE(to_text(report).find("missing input"), std::string::npos);
}

TEST(TimingReport, ATraceHoldsEverySpanAndArrow) {
  const auto report = collected(true).report();
  const auto trace = nlohmann::json::parse(to_chrome_trace(report));
  std::map<std::string, int> phases;
  for (const auto& event : trace["traceEvents"]) {
    ++phases[event["ph"]];
    if (event["ph"] != "X") continue;
    EXPECT_GE(event["dur"], 0.0);
    EXPECT_EQ(event["pid"], event["tid"] == 3 ? 1 : 0) << "grasp runs on another host";
  }
  EXPECT_EQ(phases["X"], 16);
  EXPECT_EQ(phases["M"], 12);
  EXPECT_EQ(phases["s"], 8);
  EXPECT_EQ(phases["f"], 8);
  EXPECT_EQ(phases["b"], phases["e"]);
  EXPECT_EQ(phases["b"], 12) << "words never waits";
}

/// A hundred frames, ten a second, of which every figure is worked out by hand. mask waits 1 ms and
/// works 10.0, 10.1, ... 19.9 ms; parts waits 2 ms, once 7 ms, and works 5 ms.
TEST(TimingCommand, FiguresOfAHandMadeLog) {
  const test::TemporaryFolder folder;
  {
    stage::LogWriter log(folder / "a.lcm");
    for (const auto& status :
         {ports("mask", {"RGBD_FRAME"}, {"FOREGROUND"}), ports("parts", {"FOREGROUND"}, {"PARTS"})})
      log.write(kStart, stage::kStatusChannel, encode_message(status));
    for (int i = 0; i < 100; ++i) {
      const int seq = i < 30 ? i : i + 2;  // 30 and 31 got lost
      weft::stage_timing_t mask{};
      mask.header = {0, "left", 1, seq, "camera"};
      mask.stage = "mask";
      mask.host = "robot-1";
      mask.received_utime = kStart + seq * 100'000;
      mask.started_utime = mask.received_utime + 1'000;
      mask.finished_utime = mask.started_utime + 10'000 + 100 * i;
      mask.published_utime = mask.finished_utime + 300;
      mask.cpu_us = 5'000 + 50 * i;
      auto parts = mask;
      parts.stage = "parts";
      parts.received_utime = mask.published_utime + 200;
      parts.started_utime = parts.received_utime + (i == 0 ? 7'000 : 2'000);
      parts.finished_utime = parts.started_utime + 5'000;
      parts.published_utime = parts.finished_utime + 400;
      parts.cpu_us = 9'000;
      parts.status_code = i == 10            ? weft::status_t::DROPPED
                          : i == 11          ? weft::status_t::MISSING_INPUT
                          : i < 15 && i > 11 ? weft::status_t::FAILED
                                             : weft::status_t::OK;
      for (const auto& timing : {mask, parts})
        log.write(timing.published_utime, stage::kTimingChannel, encode_message(timing));
    }
    log.close();
  }
  ASSERT_EQ(
      timing_command(folder / "a.lcm", folder / "a.json", folder / "a.html", folder / "a.trace"),
      0);
  const auto json = nlohmann::json::parse(read_text_file(folder / "a.json"));
  const auto expect = [&](const nlohmann::json& at, const std::string& prefix, double p50,
                          double p95, double p99, double max) {
    EXPECT_NEAR(at[prefix + "p50_ms"], p50, 1e-9) << prefix;
    EXPECT_NEAR(at[prefix + "p95_ms"], p95, 1e-9) << prefix;
    EXPECT_NEAR(at[prefix + "p99_ms"], p99, 1e-9) << prefix;
    EXPECT_NEAR(at[prefix + "max_ms"], max, 1e-9) << prefix;
  };
  const auto &mask = json["stages"]["mask"], &parts = json["stages"]["parts"];
  expect(mask, "", 14.9, 19.4, 19.8, 19.9);
  expect(mask, "wait_", 1, 1, 1, 1);
  expect(mask, "publish_", 0.3, 0.3, 0.3, 0.3);
  expect(mask, "cpu_", 7.45, 9.7, 9.9, 9.95);
  expect(parts, "", 5, 5, 5, 5);
  expect(parts, "wait_", 2, 2, 2, 7);
  expect(parts, "cpu_", 9, 9, 9, 9);
  // 8.9 ms more than mask's work, and 13.9 of the first frame.
  expect(json["end_to_end"], "", 23.9, 28.3, 28.7, 28.8);
  expect(json["transport"], "", 0.2, 0.2, 0.2, 0.2);
  EXPECT_EQ(json["frames"], 100);
  EXPECT_NEAR(json["frames_per_second"], 100 / 10.1288, 1e-9) << "to the end of frame 101";
  EXPECT_EQ(mask["gaps"], 2);
  EXPECT_EQ(mask["dropped"].get<int>() + mask["failed"].get<int>(), 0);
  EXPECT_EQ(parts["dropped"], 1);
  EXPECT_EQ(parts["missing_input"], 1);
  EXPECT_EQ(parts["failed"], 3);
  EXPECT_EQ(mask["critical_frames"], 100);
  EXPECT_EQ(parts["critical_frames"], 100);
  EXPECT_NEAR(mask["critical_ms"], 1 + 14.95 + 0.3, 1e-9);
  EXPECT_NEAR(parts["critical_ms"], 0.2 + 2.05 + 5 + 0.4, 1e-9);
  const auto page = read_text_file(folder / "a.html");
  const auto begin = page.find("id=\"data\">") + 10;
  const auto data =
      nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  EXPECT_EQ(data["timing"]["spans"].size(), 200u);
  const auto trace = nlohmann::json::parse(read_text_file(folder / "a.trace"));
  double work_us = 0;
  for (const auto& event : trace["traceEvents"]) {
    if (event["ph"] == "X") work_us += event["dur"].get<double>();
  }
  EXPECT_NEAR(work_us, 1000 * (100 * 14.95 + 100 * 5), 1e-3);
}

}  // namespace
}  // namespace weft
