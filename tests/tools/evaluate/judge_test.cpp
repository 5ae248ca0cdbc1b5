#include "evaluate/judge.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "dataset/augment.hpp"
#include "dataset/iri.hpp"
#include "evaluate/evaluate.hpp"
#include "messages/detections.hpp"
#include "messages/rgbd.hpp"
#include "stage/log.hpp"
#include "support/files.hpp"

namespace weft::evaluate {
namespace {

const rgbd::CameraModel kCamera{64, 48, 60, 60, 31.5, 23.5};

dataset::Scene make_scene(const std::string& name, const std::string& split) {
  dataset::Scene scene;
  scene.name = name;
  scene.frame.camera = kCamera;
  scene.frame.colour = cv::Mat(48, 64, CV_8UC3, cv::Scalar(90, 120, 150));
  scene.frame.depth = cv::Mat(48, 64, CV_16UC1, cv::Scalar(900));
  scene.frame.mask = cv::Mat(48, 64, CV_8UC1, cv::Scalar(255));
  dataset::PartPolygon polygon;
  polygon.part = "polo collar";
  polygon.points = {{5, 5}, {20, 5}, {20, 15}, {5, 15}};
  scene.polygons = {polygon};
  scene.split = split;
  return scene;
}

/// A data set of the scenes a (train), b and c (test-seen), and a log of their frames.
struct Recording {
  Recording() : writer(folder / "x.lcm") {
    for (const auto& [name, split] :
         {std::pair{"a", "train"}, {"b", "test-seen"}, {"c", "test-seen"}}) {
      dataset::write_iri(folder / "data", make_scene(name, split), {});
    }
  }
  template <class Message>
  void write(const std::string& channel, Message& message, int seq) {
    message.header.utime = 0;
    message.header.camera = "k";
    message.header.session = 0;
    message.header.seq = seq;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    writer.write(0, channel, bytes);
  }
  void frame(const std::string& source, int seq) {
    rgbd_frame_t message{};
    auto frame = make_scene("", "").frame;
    frame.source = source;
    messages::to_message(frame, {}, message);
    write("RGBD_FRAME", message, seq);
  }
  void detections(const std::vector<Eigen::Vector2d>& centres, int seq,
                  std::int8_t status = status_t::OK,
                  const std::string& channel = "PART_DETECTIONS") {
    std::vector<detector::Detection> all;
    for (const auto& centre : centres) {
      detector::Detection d;
      d.part = "polo collar";
      d.probability = 0.9 - 0.1 * static_cast<double>(all.size());
      d.box_view = {0, 0, 1, 1};
      d.centre_sensor_px = centre;
      for (auto& corner : d.corners_sensor_px) corner = centre;
      all.push_back(d);
    }
    rgbd::View view;
    view.width = kCamera.width;
    view.height = kCamera.height;
    view.sensor = kCamera;
    part_detections_t message{};
    messages::to_message(view, all, 1, message);
    message.status.code = status;
    message.status.text = status == status_t::OK ? "" : "for a reason";
    write(channel, message, seq);
  }
  std::vector<evaluation::JudgedImage> judge(const Selection& selection = {},
                                             const std::string& channel = "PART_DETECTIONS") {
    writer.close();
    return judge_log(
        folder / "x.lcm", channel, *dataset::open_dataset(folder / "data"), selection, failed,
        [](int, int) {}, [&](const std::string& t) { notes += t + "\n"; }, {});
  }
  test::TemporaryFolder folder;
  stage::LogWriter writer;
  int failed = 0;
  std::string notes;
};

TEST(JudgeLog, JoinsByNameAndTakesTheFirstOfRepeats) {
  Recording r;
  r.frame("a", 0);
  r.frame("b", 1);
  r.detections({{40, 40}, {10, 10}}, 1);  // the answers come in another order
  r.detections({{10, 10}}, 0);
  r.detections({{50, 40}}, 0);  // a repeat never says something else; if it does, it comes too late
  r.detections({{1, 1}}, 0, status_t::OK, "PART_DETECTIONS@other");
  const auto images = r.judge();
  EXPECT_EQ(r.failed, 0) << r.notes;
  ASSERT_EQ(images.size(), 2u);
  EXPECT_EQ(images[0].name, "a");
  ASSERT_EQ(images[0].detections.size(), 1u);
  EXPECT_EQ(images[0].detections[0].centre_sensor_px.x(), 10.0);
  EXPECT_EQ(images[1].detections.size(), 2u);
  const auto evaluation = evaluation::evaluate_parts(images);
  EXPECT_DOUBLE_EQ(*evaluation.mean_recall_at_1, 0.5);
}

TEST(JudgeLog, CountsFramesWithoutAnAnswerAndKeepsThemAsMisses) {
  Recording r;
  r.frame("a", 0);
  r.frame("b", 1);
  r.frame("c", 2);
  r.detections({}, 1, status_t::FAILED);
  r.detections({}, 2, status_t::NOTHING);
  const auto images = r.judge();
  EXPECT_EQ(images.size(), 3u);
  EXPECT_EQ(r.failed, 2);
  EXPECT_NE(r.notes.find("a: not answered"), std::string::npos) << r.notes;
  EXPECT_NE(r.notes.find("b: for a reason"), std::string::npos) << r.notes;
  EXPECT_DOUBLE_EQ(*evaluation::evaluate_parts(images).mean_recall_at_1, 0.0);
}

TEST(JudgeLog, TurnsTheTruthWithTheFrame) {
  Recording r;
  r.frame("a@r90m", 0);
  dataset::Augmentation turn;
  turn.angle_deg = 90;
  turn.mirror = true;
  const auto turned = dataset::augment(make_scene("a", ""), turn);
  const auto& p = turned.polygons[0].points;
  r.detections({{(p[0].x + p[2].x) / 2.0, (p[0].y + p[2].y) / 2.0}}, 0);
  EXPECT_DOUBLE_EQ(*evaluation::evaluate_parts(r.judge()).mean_recall_at_1, 1.0);
}

TEST(JudgeLog, SelectsScenesAndChannels) {
  Recording r;
  for (int i = 0; i < 3; ++i) r.frame(std::string(1, static_cast<char>('a' + i)), i);
  for (int i = 0; i < 3; ++i) r.detections({{10, 10}}, i, status_t::OK, "OTHER");
  Selection selection;
  selection.split = "test-seen";
  const auto images = r.judge(selection, "OTHER");
  ASSERT_EQ(images.size(), 2u);
  EXPECT_EQ(images[0].name, "b");
  EXPECT_EQ(r.failed, 0);
}

TEST(JudgeLog, RefusesALogOfAnotherDataset) {
  Recording r;
  r.frame("z", 0);
  EXPECT_NE(test::error_of([&] { r.judge(); }).find("z"), std::string::npos);
}

TEST(RunEvaluate, WritesTheAgreedKeys) {
  Recording r;
  r.frame("a", 0);
  r.detections({{10, 10}}, 0);
  r.writer.close();
  const std::string log = r.folder / "x.lcm", data = r.folder / "data", out = r.folder / "out.json";
  std::vector<std::string> words = {"weft-evaluate", "parts", "--log",  log,
                                    "--dataset",     data,    "--json", out};
  std::vector<char*> argv;
  for (auto& word : words) argv.push_back(word.data());
  EXPECT_EQ(run_evaluate(static_cast<int>(argv.size()), argv.data()), 0);
  const auto json = nlohmann::json::parse(std::ifstream(out));
  EXPECT_EQ(json["map"], 1.0);
  const auto& part = json["parts"]["polo collar"];
  for (const char* key :
       {"positives", "recall_at_1", "recall_at_3", "recall_at_5", "oracle_at_1", "ap", "ap11"}) {
    EXPECT_EQ(part[key], 1) << key;
  }
  EXPECT_TRUE(part.contains("chance_at_1"));
  EXPECT_EQ(json["parts"]["jeans hips"]["positives"], 0);
  EXPECT_TRUE(json["parts"]["jeans hips"]["ap"].is_null());

  words.resize(2);
  argv.resize(2);
  EXPECT_EQ(run_evaluate(2, argv.data()), 2);
}

}  // namespace
}  // namespace weft::evaluate
