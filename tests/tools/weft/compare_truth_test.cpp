#include "tools/weft/compare_truth.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "dataset/iri.hpp"
#include "integration/test_log.hpp"
#include "messages/detections.hpp"
#include "support/files.hpp"
#include "tools/weft/compare.hpp"
#include "tools/weft/message.hpp"

namespace weft {
namespace {

const Eigen::Vector2d kOn{10, 10}, kOff{50, 40};  // the collar and beside it

class CompareTruth : public testing::Test {
 protected:
  CompareTruth() {
    for (int i = 0; i < 5; ++i) {
      dataset::Scene scene;
      scene.name = "scene " + std::to_string(i);
      scene.frame.camera = {64, 48, 60, 60, 31.5, 23.5};
      scene.frame.colour = cv::Mat(48, 64, CV_8UC3, cv::Scalar(90, 120, 150));
      scene.frame.depth = cv::Mat(48, 64, CV_16UC1, cv::Scalar(900));
      dataset::PartPolygon collar;
      collar.part = "polo collar";
      collar.points = {{5, 5}, {20, 5}, {20, 15}, {5, 15}};
      scene.polygons = {collar};
      dataset::write_iri(folder_ / "data", scene, {});
    }
  }
  struct Answer {
    int scene;
    std::vector<Eigen::Vector2d> centres;  // most probable first
    bool answered = true;
  };
  void write(const std::string& name, const std::string& channel,
             const std::vector<Answer>& answers) const {
    stage::LogWriter log(folder_ / name);
    for (const auto& answer : answers) {
      log.write(0, "RGBD_FRAME", test_stage::test_event(answer.scene, 100).data);
      if (!answer.answered) continue;
      std::vector<detector::Detection> detections;
      for (const auto& centre : answer.centres) {
        detector::Detection d;
        d.part = "polo collar";
        d.probability = 0.9 - 0.1 * static_cast<double>(detections.size());
        d.box_view = {0, 0, 1, 1};
        d.centre_sensor_px = centre;
        for (auto& corner : d.corners_sensor_px) corner = centre;
        detections.push_back(d);
      }
      rgbd::View view;
      view.width = 64;
      view.height = 48;
      view.sensor = {64, 48, 60, 60, 31.5, 23.5};
      weft::part_detections_t message{};
      messages::to_message(view, detections, 1, message);
      message.header = {0, "camera", 7, answer.scene, "camera"};
      log.write(0, channel, encode_message(message));
    }
    log.close();
  }
  const test::TemporaryFolder folder_;
};

TEST_F(CompareTruth, SaysByHowMuchAndWhere) {
  write("a.lcm", "PART_DETECTIONS",
        {{0, {kOn}}, {1, {kOn}}, {2, {kOff, kOn}}, {3, {}, false}, {4, {kOn}}});
  write("b.lcm", "PART_DETECTIONS", {{3, {}}, {0, {kOn}}, {1, {kOff}}, {2, {kOn}}});
  CompareOptions options;
  options.truth = folder_ / "data";
  const auto c =
      compare_logs(folder_ / "a.lcm", folder_ / "b.lcm", options, MessageTypes::built_in());
  ASSERT_TRUE(c.truth);
  EXPECT_EQ(c.truth->images, 4u) << "scene 4 is in A alone";
  EXPECT_EQ(c.truth->failed_a, 1u);
  EXPECT_EQ(c.truth->failed_b, 0u);
  ASSERT_EQ(c.truth->changes.size(), 2u);
  EXPECT_EQ(c.truth->changes[0].image, "scene 1");
  EXPECT_FALSE(c.truth->changes[0].gained);
  EXPECT_EQ(c.truth->changes[1].image, "scene 2");
  EXPECT_TRUE(c.truth->changes[1].gained);
  const auto json = nlohmann::json::parse(to_json(c))["truth"];
  const auto& collar = json["parts"]["polo collar"];
  EXPECT_EQ(collar["recall_at_1"]["a"], 0.5);
  EXPECT_EQ(collar["recall_at_1"]["difference"], 0.0);
  EXPECT_EQ(collar["recall_at_3"]["a"], 0.75);
  EXPECT_EQ(collar["recall_at_3"]["difference"], -0.25);
  EXPECT_NEAR(collar["ap"]["a"], 0.6875, 1e-9) << "hits 1 1 0 1 of 4";
  EXPECT_NEAR(collar["ap"]["b"], 5.0 / 12.0, 1e-9) << "hits 1 0 1 of 4";
  EXPECT_NEAR(json["map"]["difference"], 5.0 / 12.0 - 0.6875, 1e-9);
  EXPECT_EQ(json["parts"]["jeans hips"]["ap"]["difference"], nullptr) << "no such part";
  const auto text = to_text(c);
  EXPECT_NE(text.find("polo collar                    4      50.0      50.0      +0.0      75.0"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("right in B alone in 1 images, in A alone in 1"), std::string::npos) << text;
  // The page shows the truth in the pictures.
  const auto page = to_page(c, 5);
  const auto begin = page.find("id=\"data\">") + 10;
  const auto data =
      nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  ASSERT_FALSE(data["frames"].empty());
  EXPECT_EQ(data["frames"][0]["truth"][0]["part"], "polo collar");
  EXPECT_EQ(data["truth"]["rows"][0][0], "polo collar");
}

TEST_F(CompareTruth, JudgesAVariantOnItsOwnChannel) {
  write("a.lcm", "PART_DETECTIONS", {{0, {kOn}}, {1, {kOff}}});
  write("v.lcm", "PART_DETECTIONS@x", {{0, {kOn}}, {1, {kOn}}});
  stage::LogWriter both(folder_ / "both.lcm");
  for (const std::string name : {"a.lcm", "v.lcm"}) {
    stage::LogReader log(folder_ / name);
    for (stage::LogEvent event; log.next(event);) both.write(0, event.channel, event.data);
  }
  both.close();
  CompareOptions options;
  options.truth = folder_ / "data";
  options.variant = "x";
  const auto c = compare_logs(folder_ / "both.lcm", "", options, MessageTypes::built_in());
  EXPECT_EQ(*c.truth->a.mean_recall_at_1, 0.5);
  EXPECT_EQ(*c.truth->b.mean_recall_at_1, 1.0);
}

TEST_F(CompareTruth, RunsOfOtherScenesAreAnError) {
  write("a.lcm", "PART_DETECTIONS", {{0, {kOn}}});
  write("b.lcm", "PART_DETECTIONS", {{1, {kOn}}});
  const auto text = test::error_of([&] {
    compare_with_truth(folder_ / "a.lcm", "PART_DETECTIONS", folder_ / "b.lcm", "PART_DETECTIONS",
                       folder_ / "data", 0.2);
  });
  EXPECT_NE(text.find("none of its scenes is in both runs"), std::string::npos) << text;
}

}  // namespace
}  // namespace weft
