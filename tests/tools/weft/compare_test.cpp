#include "tools/weft/compare.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "integration/test_log.hpp"
#include "lib/stage/fake_stage.hpp"
#include "support/files.hpp"
#include "tools/weft/message.hpp"
#include "weft/grasps_t.hpp"
#include "weft/part_detections_t.hpp"

namespace weft {
namespace {

weft::part_detection_t detection(const std::string& part, double x, double y, double probability) {
  weft::part_detection_t d{};
  d.part = part;
  d.probability = probability;
  const double corners[4][2] = {{x, y}, {x + 40, y}, {x + 40, y + 20}, {x, y + 20}};
  std::copy(&corners[0][0], &corners[0][0] + 8, &d.corners_sensor[0][0]);
  return d;
}

class Compare : public testing::Test {
 protected:
  using Edit = std::function<void(std::int64_t, weft::part_detections_t&, weft::grasps_t&)>;
  static void write_frames(stage::LogWriter& log, const std::string& suffix, double work_ms,
                           const Edit& edit) {
    for (std::int64_t seq = 0; seq < 6; ++seq) {
      const auto image = test_stage::test_event(seq, 500);
      const weft::header_t header{0, "camera", 7, seq, "camera"};
      if (suffix.empty()) log.write(seq, "RGBD_FRAME", image.data);
      auto found = stage::fake::message<part_detections_t>(header);
      found.detections = {detection("collar", 100, 100, 0.8), detection("sleeve", 10, 10, 0.5),
                          detection("sleeve", 200, 10, 0.05)};
      auto grasps = stage::fake::message<grasps_t>(header);
      grasps.grasps.resize(1);
      grasps.grasps[0].part = "collar";
      edit(seq, found, grasps);
      found.detection_count = static_cast<std::int32_t>(found.detections.size());
      grasps.grasp_count = 1;
      log.write(seq, "PART_DETECTIONS" + suffix, encode_message(found));
      log.write(seq, "GRASPS" + suffix, encode_message(grasps));
      weft::stage_timing_t timing{};
      timing.header = header;
      timing.stage = "refine" + suffix;
      timing.started_utime = 1000 * seq;
      timing.finished_utime = timing.started_utime + static_cast<std::int64_t>(work_ms * 1000);
      timing.published_utime = timing.finished_utime;
      log.write(seq, "STAGE_TIMING", encode_message(timing));
    }
  }
  static void plain(std::int64_t, weft::part_detections_t&, weft::grasps_t&) {}
  /// Frame 2 loses the collar and gains a hood, in frame 3 the collar moves a little, in frame 4
  /// only what is below the threshold changes.
  static void edited(std::int64_t seq, weft::part_detections_t& found, weft::grasps_t& grasps) {
    if (seq == 2) found.detections[0] = detection("hood", 100, 100, 0.9);
    if (seq == 3) {
      found.detections[0] = detection("collar", 103, 104, 0.7);
      grasps.grasps[0].point_camera_m[1] = 0.012;
    }
    if (seq == 4) found.detections[2].probability = 0.06;
  }
  void write(const std::string& name, double work_ms, const Edit& edit) const {
    stage::LogWriter log(folder_ / name);
    write_frames(log, "", work_ms, edit);
    log.close();
  }
  void expect_edited(const Comparison& c) const {
    EXPECT_FALSE(c.same());
    EXPECT_EQ(c.frames, 6u);
    ASSERT_EQ(c.different.size(), 3u);
    EXPECT_EQ(c.different[0].frame.seq, 2);
    EXPECT_EQ(c.different[0].gained.size(), 1u);
    EXPECT_EQ(c.different[0].lost.size(), 1u);
    EXPECT_EQ(c.different[1].channels, (std::vector<std::string>{"PART_DETECTIONS", "GRASPS"}));
    EXPECT_EQ(c.gained, 1u);
    EXPECT_EQ(c.lost, 1u);
    EXPECT_EQ(c.kept, 11u);
    EXPECT_NEAR(c.probability_shift, 0.1, 1e-9);
    EXPECT_NEAR(c.corner_shift_px, 5, 1e-9);
    EXPECT_NEAR(c.grasp_shift_mm.max, 12, 1e-9);
    const auto& channel = c.channels.at("PART_DETECTIONS");
    EXPECT_EQ(channel.equal, 3u);
    EXPECT_EQ(channel.different, 3u);
    EXPECT_EQ(channel.fields.at("detections.probability"), 3u);
    EXPECT_EQ(channel.fields.at("detections.part"), 1u);
    ASSERT_EQ(c.timing_b.stages.size(), 1u);
    EXPECT_EQ(c.timing_b.stages[0].stage, "refine");
    EXPECT_NEAR(c.timing_a.stages[0].work.p50, 4, 1e-9);
    EXPECT_NEAR(c.timing_b.stages[0].work.p50, 2, 1e-9);
    EXPECT_EQ(nlohmann::json::parse(to_json(c))["parts"]["hood"]["gained"], 1);
    EXPECT_NE(to_text(c).find("3 of 6 frames differ: 2, 3, 4"), std::string::npos) << to_text(c);
    EXPECT_NE(to_text(c).find("0.50"), std::string::npos) << "B / A";
  }
  const MessageTypes& types_ = MessageTypes::built_in();
  const test::TemporaryFolder folder_;
};

TEST_F(Compare, TheSameIsTheSame) {
  write("a.lcm", 4, plain);
  write("b.lcm", 2, plain);
  const auto c = compare_logs(folder_ / "a.lcm", folder_ / "b.lcm", {}, types_);
  EXPECT_TRUE(c.same());
  EXPECT_TRUE(c.different.empty());
  EXPECT_EQ(c.kept, 12u);
  EXPECT_EQ(c.corner_shift_px, 0);
}

TEST_F(Compare, SaysWhatDiffers) {
  write("a.lcm", 4, plain);
  write("b.lcm", 2, edited);
  expect_edited(compare_logs(folder_ / "a.lcm", folder_ / "b.lcm", {}, types_));
}

TEST_F(Compare, AVariantBesideItsBaseline) {
  {
    stage::LogWriter log(folder_ / "a.lcm");
    write_frames(log, "", 4, plain);
    write_frames(log, "@fast", 2, edited);
    // Before and after both, of the baseline alone.
    for (const std::string stage : {"mask", "grasp"}) {
      weft::stage_timing_t timing{};
      timing.header = {0, "camera", 7, 2, "camera"};
      timing.stage = stage;
      timing.received_utime = stage == "mask" ? -5000 : 50'000;
      timing.published_utime = timing.received_utime + 1;
      log.write(9, "STAGE_TIMING", encode_message(timing));
    }
    log.close();
  }
  CompareOptions options;
  options.variant = "fast";
  const auto c = compare_logs(folder_ / "a.lcm", "", options, types_);
  expect_edited(c);
  EXPECT_EQ(c.timing_a.stages.size(), 3u) << "the variant's stages are no part of the baseline";
  // Of frame 2: the mask began at -5 ms, refine ended at 6 and its variant at 4 ms.
  EXPECT_NEAR(c.timing_a.end_to_end.max, 11, 1e-9);
  EXPECT_NEAR(c.timing_b.end_to_end.max, 9, 1e-9);
  EXPECT_FALSE(c.channels.contains("RGBD_FRAME"));
  options.variant = "slow";
  EXPECT_THROW(compare_logs(folder_ / "a.lcm", "", options, types_), Error);
}

TEST_F(Compare, FramesOfOneRunAloneAreCounted) {
  write("a.lcm", 4, plain);
  stage::LogWriter log(folder_ / "b.lcm");
  stage::LogReader a(folder_ / "a.lcm");
  for (stage::LogEvent event; a.next(event);) {
    const auto name = read_frame_name(event.data);
    if (event.channel != "GRASPS" || name->seq != 5)
      log.write(event.timestamp_us, event.channel, event.data);
  }
  log.close();
  const auto c = compare_logs(folder_ / "a.lcm", folder_ / "b.lcm", {}, types_);
  EXPECT_FALSE(c.same());
  EXPECT_EQ(c.channels.at("GRASPS").only_a, 1u);
  EXPECT_EQ(
      compare_logs(folder_ / "b.lcm", folder_ / "a.lcm", {}, types_).channels.at("GRASPS").only_b,
      1u);
}

TEST_F(Compare, ThePageHoldsItsPictures) {
  write("a.lcm", 4, plain);
  write("b.lcm", 2, edited);
  const auto c = compare_logs(folder_ / "a.lcm", folder_ / "b.lcm", {}, types_);
  const auto page = to_page(c, 2);
  const auto begin = page.find("id=\"data\">") + 10;
  const auto data =
      nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  ASSERT_EQ(data["frames"].size(), 2u);
  EXPECT_EQ(data["hidden"], 1);
  EXPECT_EQ(data["frames"][0]["gained"].size(), 1u) << "the most different first";
  EXPECT_EQ(data["frames"][0]["source"], "scene 2");
  EXPECT_EQ(page.find("{{"), std::string::npos);
  EXPECT_EQ(page.find("https://"), std::string::npos);
}

TEST(Overlap, IsIntersectionOverUnion) {
  const auto at = [](double x, double y) {
    Detection d;
    d.corners = {{{x, y}, {x + 10, y}, {x + 10, y + 10}, {x, y + 10}}};
    return d;
  };
  EXPECT_NEAR(overlap(at(0, 0), at(0, 0)), 1, 1e-12);
  EXPECT_NEAR(overlap(at(0, 0), at(5, 0)), 50.0 / 150.0, 1e-12);
  EXPECT_EQ(overlap(at(0, 0), at(10, 0)), 0);
}

}  // namespace
}  // namespace weft
