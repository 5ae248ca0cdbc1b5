#include "procs/prior/stage.hpp"

#include <gtest/gtest.h>

#include "detector/prior.hpp"
#include "lib/detector/random_words.hpp"
#include "messages/prior.hpp"
#include "messages/words.hpp"
#include "support/files.hpp"
#include "support/one_stage.hpp"

namespace weft::prior_process {
namespace {

struct PriorStage : testing::Test {
  PriorStage() : random(1), grid(detector::random_words("sift", 30, 25, 20, random)) {
    grid.view.sensor = {grid.view.width, grid.view.height, 100.0, 100.0, 90.0, 80.0};
    model.blocks = {{grid.descriptor, grid.vocabulary_hash, grid.vocabulary_size}};
    for (const char* name : {"polo collar", "jeans hips"}) {
      detector::PartPriorModel part;
      part.part = name;
      for (int w = 0; w < 20; ++w) part.weights.push_back(random.normal());
      part.threshold = model.parts.empty() ? 1.0 : 0.0;  // never, always searched
      model.parts.push_back(part);
    }
    model.write(folder / "prior.blob");
  }
  image_prior_t answer(const std::string& text = "", std::int8_t words_status = status_t::OK) {
    words_t words{};
    messages::to_message(grid, words);
    words.status.code = words_status;
    words.status.reason = static_cast<std::int16_t>(stage::Reason::kNoGarment);
    test::OneStage stage(
        make_stage(Settings::from_text("model: " + (folder / "prior.blob") + "\n" + text, "test")));
    stage.send("WORDS_SIFT", words, 0);
    stage.run();
    return stage.received<image_prior_t>("IMAGE_PRIOR");
  }
  test::TemporaryFolder folder;
  Random random;
  bovw::WordGrid grid;
  detector::PriorModel model;
};

TEST_F(PriorStage, AnswersInEveryMode) {
  const std::vector<const bovw::WordGrid*> grids = {&grid};
  for (const auto& [text, mode] : {std::pair{"off", detector::PriorMode::kOff},
                                   {"soft", detector::PriorMode::kSoft},
                                   {"hard", detector::PriorMode::kHard}}) {
    const auto got = answer("mode: \"" + std::string(text) + "\"\n");
    ASSERT_EQ(got.status.code, status_t::OK) << got.status.text;
    EXPECT_NE(got.model_hash, 0);
    const auto content = messages::from_message(got);
    EXPECT_EQ(content.mode, mode);
    const auto expected = detector::evaluate_prior(model, grids, mode);
    ASSERT_EQ(content.parts.size(), 2u);
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_EQ(content.parts[i].part, expected[i].part);
      EXPECT_EQ(content.parts[i].probability, expected[i].probability);
      EXPECT_EQ(content.parts[i].searched, expected[i].searched);
    }
    EXPECT_EQ(content.parts[0].searched, mode != detector::PriorMode::kHard);
  }
}

TEST_F(PriorStage, SaysWhyThereIsNothing) {
  auto got = answer("", status_t::NOTHING);
  EXPECT_EQ(got.status.code, status_t::NOTHING);
  EXPECT_EQ(got.status.reason, static_cast<int>(stage::Reason::kNoGarment));
  for (auto& cell : grid.cells) cell = std::min(cell, bovw::WordGrid::kNoWord);
  got = answer();
  EXPECT_EQ(got.status.code, status_t::NOTHING);
  EXPECT_EQ(got.status.reason, static_cast<int>(stage::Reason::kNoWords));
}

TEST_F(PriorStage, RefusesWhatDoesNotFit) {
  EXPECT_NE(test::error_of([&] { answer("words: [WORDS_SIFT, WORDS_FPFH]\n"); }).find("1 channels"),
            std::string::npos);
  grid.vocabulary_hash ^= 1;
  EXPECT_EQ(answer().status.code, status_t::FAILED);
}

}  // namespace
}  // namespace weft::prior_process
