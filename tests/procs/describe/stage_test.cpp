#include "procs/describe/stage.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "bovw/describe.hpp"
#include "messages/foreground.hpp"
#include "messages/rgbd.hpp"
#include "messages/words.hpp"
#include "support/files.hpp"
#include "support/one_stage.hpp"

namespace weft::describe_process {
namespace {

struct DescribeStage : testing::Test {
  DescribeStage() {
    frame.camera = {160, 120, 130.0, 130.0, 80.0, 60.0};
    frame.colour = cv::Mat(120, 160, CV_8UC3, cv::Scalar(100, 100, 100));
    frame.depth = cv::Mat(120, 160, CV_16UC1, cv::Scalar(900));
    foreground.mask = cv::Mat(120, 160, CV_8UC1, cv::Scalar(0));
    foreground.table = rgbd::Plane{-Eigen::Vector3d::UnitZ(), -0.91, 0.001, 1000};
    Random random(1);
    for (int y = 30; y < 90; ++y) {
      for (int x = 30; x < 130; ++x) {
        foreground.mask.at<std::uint8_t>(y, x) = 255;
        frame.colour.at<cv::Vec3b>(y, x) =
            cv::Vec3b::all(static_cast<std::uint8_t>(random.below(256)));
      }
    }
    options.view.scale_px_per_m = 200.0;
    Random noise(2);
    std::vector<std::uint8_t> centres(8 * 128);
    for (auto& value : centres) value = static_cast<std::uint8_t>(noise.below(120));
    vocabulary = std::make_unique<bovw::Vocabulary>("sift", 128, centres, options_hash(options),
                                                    options_to_yaml(options));
    vocabulary->write(folder / "vocabulary.blob");
  }
  Settings settings(const std::string& text = "") {
    return Settings::from_text("vocabulary: " + (folder / "vocabulary.blob") + "\n" + text, "test");
  }
  rgbd_frame_t frame_message() {
    rgbd_frame_t message{};
    messages::FrameEncoding encoding;
    encoding.colour = messages::FrameEncoding::Colour::kPng;
    messages::to_message(frame, encoding, message);
    return message;
  }
  words_t answer(const foreground_t& foreground_message) {
    test::OneStage stage(make_stage(settings()));
    stage.send("RGBD_FRAME", frame_message(), 0);
    stage.send("FOREGROUND", foreground_message, 0);
    stage.run();
    return stage.received<words_t>("WORDS_SIFT");
  }
  foreground_t foreground_message() {
    foreground_t message{};
    messages::to_message(foreground, message);
    return message;
  }
  test::TemporaryFolder folder;
  rgbd::RgbdFrame frame;
  foreground::Foreground foreground;
  bovw::DescribeOptions options;
  std::unique_ptr<bovw::Vocabulary> vocabulary;
};

TEST_F(DescribeStage, AnswersTheWordsOfTheFrame) {
  const auto message = answer(foreground_message());
  ASSERT_EQ(message.status.code, status_t::OK) << message.status.text;
  const auto words = messages::from_message(message);
  const auto descriptor = descriptor::make_descriptor(options.descriptor);
  const auto expected = bovw::quantise(
      bovw::describe_frame(frame, foreground.mask, &*foreground.table, options, *descriptor, 1),
      "sift", *vocabulary, 1);
  EXPECT_EQ(words.cells, expected.cells);
  EXPECT_EQ(words.columns, expected.columns);
  EXPECT_EQ(words.vocabulary_hash, vocabulary->hash());
  EXPECT_EQ(words.view.kind, rgbd::View::Kind::kRectified);
  EXPECT_GT(std::count_if(words.cells.begin(), words.cells.end(), [](auto c) { return c >= 0; }),
            50);
}

TEST_F(DescribeStage, SaysWhyThereIsNothing) {
  const auto reason = [](const words_t& message) {
    EXPECT_EQ(message.status.code, status_t::NOTHING);
    return static_cast<stage::Reason>(message.status.reason);
  };
  auto message = foreground_message();
  message.status.code = status_t::NOTHING;
  message.status.reason = static_cast<std::int16_t>(stage::Reason::kNoGarment);
  EXPECT_EQ(reason(answer(message)), stage::Reason::kNoGarment);
  const auto table = foreground.table;
  foreground.table.reset();
  EXPECT_EQ(reason(answer(foreground_message())), stage::Reason::kNoTable);
  foreground.table = table;
  frame.colour.setTo(cv::Scalar(90, 90, 90));
  EXPECT_EQ(reason(answer(foreground_message())), stage::Reason::kNoWords);
  foreground.mask.setTo(cv::Scalar(0));
  EXPECT_EQ(reason(answer(foreground_message())), stage::Reason::kNoGarment);
}

TEST_F(DescribeStage, AMaskOfAnotherSizeIsInvalid) {
  foreground.mask = cv::Mat(60, 160, CV_8UC1, cv::Scalar(255));
  const auto message = answer(foreground_message());
  EXPECT_EQ(message.status.code, status_t::FAILED);
  EXPECT_EQ(message.status.reason, static_cast<int>(stage::Reason::kInvalidInput));
}

TEST_F(DescribeStage, SettingsComeFromTheVocabularyAndOthersAreRefused) {
  EXPECT_NO_THROW(make_stage(settings()));
  EXPECT_NO_THROW(make_stage(settings("view:\n  scale_px_per_m: 200\nthreads: 1\n")));
  const auto text = test::error_of([&] { make_stage(settings("grid:\n  step_px: 7\n")); });
  EXPECT_NE(text.find("step_px: 7"), std::string::npos) << text;
  EXPECT_NE(test::error_of([&] { make_stage(settings("veiw: 3\n")); }).find("veiw"),
            std::string::npos);
  std::filesystem::remove(folder / "vocabulary.blob");
  EXPECT_NE(test::error_of([&] { make_stage(settings()); }).find("vocabulary.blob"),
            std::string::npos);
}

}  // namespace
}  // namespace weft::describe_process
