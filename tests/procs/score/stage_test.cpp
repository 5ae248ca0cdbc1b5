#include "procs/score/stage.hpp"

#include <gtest/gtest.h>

#include "detector/part_scorer.hpp"
#include "lib/detector/random_words.hpp"
#include "messages/candidates.hpp"
#include "messages/maps.hpp"
#include "messages/prior.hpp"
#include "messages/words.hpp"
#include "support/files.hpp"
#include "support/one_stage.hpp"

namespace weft::score_process {
namespace {

struct ScoreStage : testing::Test {
  ScoreStage() : random(1), grid(detector::random_words("sift", 30, 25, 20, random)) {
    grid.view.sensor = {grid.view.width, grid.view.height, 100.0, 100.0, 90.0, 80.0};
    model = detector::random_model({&grid}, 2, {{60, 40}}, random);
    model.parts[0].part = "polo collar";
    model.parts[1].part = "jeans hips";
    model.write(folder / "score.blob");
    for (const auto& part : model.parts) priors.push_back({part.part, 0.5, 0.1, true});
  }
  Settings settings(const std::string& text = "") {
    return Settings::from_text("model: " + (folder / "score.blob") + "\n" + text, "test");
  }
  struct Answer {
    part_candidates_t candidates;
    probability_map_t map;
  };
  Answer answer(detector::PriorMode mode, const std::string& text = "") {
    words_t words{};
    messages::to_message(grid, words);
    image_prior_t prior{};
    messages::to_message(priors, mode, 1, prior);
    return answer(words, prior, text);
  }
  Answer answer(const words_t& words, const image_prior_t& prior, const std::string& text = "") {
    test::OneStage stage(make_stage(settings(text)));
    stage.send("WORDS_SIFT", words, 0);
    stage.send("IMAGE_PRIOR", prior, 0);
    stage.run();
    return {stage.received<part_candidates_t>("PART_CANDIDATES"),
            stage.received<probability_map_t>("PROBABILITY_MAP")};
  }
  test::TemporaryFolder folder;
  Random random;
  bovw::WordGrid grid;
  detector::ScoreModel model;
  std::vector<detector::PartPrior> priors;
};

TEST_F(ScoreStage, AnswersCandidatesAndMaps) {
  const auto got = answer(detector::PriorMode::kSoft);
  ASSERT_EQ(got.candidates.status.code, status_t::OK) << got.candidates.status.text;
  const std::vector<const bovw::WordGrid*> grids = {&grid};
  const auto expected =
      detector::score_parts(model, grids, priors, detector::PriorMode::kSoft, {}, 1);
  const auto candidates = messages::from_message(got.candidates);
  ASSERT_EQ(candidates.size(), expected.candidates.size());
  ASSERT_FALSE(candidates.empty());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    EXPECT_EQ(candidates[i].part, expected.candidates[i].part);
    EXPECT_EQ(candidates[i].column, expected.candidates[i].column);
    EXPECT_EQ(candidates[i].probability, expected.candidates[i].probability);
    EXPECT_EQ(candidates[i].prior, 0.5);
  }
  const auto maps = messages::from_message(got.map);
  ASSERT_EQ(maps.maps.size(), 2u);
  EXPECT_EQ(maps.maps[1].values, expected.maps[1].values);
}

TEST_F(ScoreStage, PriorRulesPartsOut) {
  priors[0].searched = false;
  auto got = answer(detector::PriorMode::kHard);
  EXPECT_EQ(got.candidates.status.code, status_t::OK);
  ASSERT_EQ(got.map.map_count, 1);
  EXPECT_EQ(got.map.maps[0].part, "jeans hips");
  priors[1].searched = false;
  got = answer(detector::PriorMode::kHard);
  for (const auto& status : {got.candidates.status, got.map.status}) {
    EXPECT_EQ(status.code, status_t::NOTHING);
    EXPECT_EQ(status.reason, static_cast<int>(stage::Reason::kNotSearched));
  }
}

TEST_F(ScoreStage, SaysWhenNothingIsFoundAndPassesOnWhyThereIsNoInput) {
  auto got = answer(detector::PriorMode::kOff, "peaks:\n  min_probability: 1.0\n");
  EXPECT_EQ(got.candidates.status.code, status_t::NOTHING);
  EXPECT_EQ(got.candidates.status.reason, static_cast<int>(stage::Reason::kNothingFound));
  EXPECT_EQ(got.map.status.code, status_t::OK);
  words_t words{};
  messages::to_message(grid, words);
  words.status.code = status_t::NOTHING;
  words.status.reason = static_cast<std::int16_t>(stage::Reason::kNoGarment);
  image_prior_t prior{};
  messages::to_message(priors, detector::PriorMode::kOff, 1, prior);
  got = answer(words, prior);
  EXPECT_EQ(got.map.status.code, status_t::NOTHING);
  EXPECT_EQ(got.map.status.reason, static_cast<int>(stage::Reason::kNoGarment));
}

TEST_F(ScoreStage, WordsOfAnotherVocabularyFail) {
  grid.vocabulary_hash ^= 1;
  const auto got = answer(detector::PriorMode::kOff);
  EXPECT_EQ(got.candidates.status.code, status_t::FAILED);
  EXPECT_EQ(got.map.status.code, status_t::FAILED);
}

TEST_F(ScoreStage, ChannelsMustFitTheModel) {
  EXPECT_NE(test::error_of([&] {
              make_stage(settings("words: [WORDS_SIFT, WORDS_FPFH]\n"));
            }).find("1 channels"),
            std::string::npos);
}

}  // namespace
}  // namespace weft::score_process
