#include "procs/refine/stage.hpp"

#include <gtest/gtest.h>

#include "detector/refiner.hpp"
#include "lib/detector/random_words.hpp"
#include "messages/candidates.hpp"
#include "messages/detections.hpp"
#include "messages/words.hpp"
#include "support/files.hpp"
#include "support/one_stage.hpp"

namespace weft::refine_process {
namespace {

struct RefineStage : testing::Test {
  RefineStage() : random(1), grid(detector::random_words("sift", 30, 25, 20, random)) {
    grid.view.sensor = {grid.view.width, grid.view.height, 100.0, 100.0, 90.0, 80.0};
    model.blocks = {{grid.descriptor, grid.vocabulary_hash, grid.vocabulary_size}};
    detector::PartSvm svm;
    svm.part = "polo collar";
    svm.shapes = {{60, 40}, {40, 60}};
    for (int i = 0; i < 20 * 20; ++i) {
      svm.counts.push_back(static_cast<std::int32_t>(random.below(6)));
    }
    for (int i = 0; i < 20; ++i) svm.coefficients.push_back(random.normal());
    model.parts = {svm};
    model.write(folder / "refine.blob");
    for (int i = 0; i < 3; ++i) {
      detector::Candidate candidate;
      candidate.part = "polo collar";
      candidate.column = 8 + 6 * i;
      candidate.row = 12;
      candidate.prior = i == 0 ? 0.25 : 1.0;
      candidates.push_back(candidate);
    }
  }
  part_detections_t answer(const std::string& text = "",
                           std::int8_t candidates_status = status_t::OK) {
    words_t words{};
    messages::to_message(grid, words);
    part_candidates_t message{};
    messages::to_message(candidates, 5, message);
    message.status.code = candidates_status;
    message.status.reason = static_cast<std::int16_t>(stage::Reason::kNotSearched);
    test::OneStage stage(make_stage(
        Settings::from_text("model: " + (folder / "refine.blob") + "\n" + text, "test")));
    stage.send("WORDS_SIFT", words, 0);
    stage.send("PART_CANDIDATES", message, 0);
    stage.run();
    return stage.received<part_detections_t>("PART_DETECTIONS");
  }
  test::TemporaryFolder folder;
  Random random;
  bovw::WordGrid grid;
  detector::RefineModel model;
  std::vector<detector::Candidate> candidates;
};

TEST_F(RefineStage, AnswersDetections) {
  const auto got = answer();
  ASSERT_EQ(got.status.code, status_t::OK) << got.status.text;
  EXPECT_NE(got.model_hash, 0);
  const std::vector<const bovw::WordGrid*> grids = {&grid};
  const auto expected = detector::Refiner(model, {}).refine(grids, candidates, 1);
  const auto content = messages::from_message(got);
  EXPECT_EQ(content.view.width, grid.view.width);
  ASSERT_FALSE(expected.empty());
  ASSERT_EQ(content.detections.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(content.detections[i].probability, expected[i].probability);
    EXPECT_EQ(content.detections[i].box_view.x, expected[i].box_view.x);
    EXPECT_EQ(content.detections[i].centre_sensor_px, expected[i].centre_sensor_px);
  }
}

TEST_F(RefineStage, TheThreadCountDecidesNothing) {
  const auto one = answer("threads: 1\n"), three = answer("threads: 3\n");
  std::vector<std::uint8_t> a(static_cast<std::size_t>(one.getEncodedSize()));
  std::vector<std::uint8_t> b(static_cast<std::size_t>(three.getEncodedSize()));
  one.encode(a.data(), 0, static_cast<int>(a.size()));
  three.encode(b.data(), 0, static_cast<int>(b.size()));
  EXPECT_EQ(a, b);
}

TEST_F(RefineStage, KeepsOnlyLikelyDetections) {
  const auto all = messages::from_message(answer()).detections;
  ASSERT_GT(all.size(), 1u);
  const double limit = (all[0].probability + all[1].probability) / 2;
  EXPECT_EQ(answer("min_probability: " + std::to_string(limit) + "\n").detection_count, 1);
  const auto none = answer("min_probability: 1.0\n");
  EXPECT_EQ(none.status.code, status_t::NOTHING);
  EXPECT_EQ(none.status.reason, static_cast<int>(stage::Reason::kNothingFound));
}

TEST_F(RefineStage, PassesOnWhyThereIsNoInput) {
  const auto got = answer("", status_t::NOTHING);
  EXPECT_EQ(got.status.code, status_t::NOTHING);
  EXPECT_EQ(got.status.reason, static_cast<int>(stage::Reason::kNotSearched));
}

TEST_F(RefineStage, RefusesWhatDoesNotFit) {
  candidates[0].column = 30;
  EXPECT_EQ(answer().status.code, status_t::FAILED);
  candidates[0].column = 3;
  candidates[0].part = "jeans hips";  // a part the model does not know
  EXPECT_EQ(answer().status.code, status_t::FAILED);
  candidates[0].part = "polo collar";
  grid.vocabulary_hash ^= 1;
  EXPECT_EQ(answer().status.code, status_t::FAILED);
  EXPECT_NE(test::error_of([&] { answer("words: [WORDS_SIFT, WORDS_FPFH]\n"); }).find("1 channels"),
            std::string::npos);
}

}  // namespace
}  // namespace weft::refine_process
