#include "detector/part_scorer.hpp"

#include <gtest/gtest.h>

#include "lib/detector/random_words.hpp"

namespace weft::detector {
namespace {

struct PartScorer : testing::Test {
  PartScorer() : random(1), grid(random_words("sift", 40, 30, 30, random)) {
    model = random_model({&grid}, 4, {{60, 40}, {90, 60}}, random);
    // Each part likes one place: a patch of its own word.
    for (int p = 0; p < 4; ++p) {
      for (int y = 0; y < 5; ++y) {
        for (int x = 0; x < 5; ++x)
          grid.cells[static_cast<std::size_t>((9 + 8 * (p / 2) + y) * 40 + 12 + 12 * (p % 2) + x)] =
              static_cast<std::int16_t>(p);
      }
      auto& weights = model.parts[static_cast<std::size_t>(p)].weights[0];
      std::fill(weights.begin(), weights.end(), 0);
      weights[static_cast<std::size_t>(p)] = 10 << 16;
      model.parts[static_cast<std::size_t>(p)].bias = -5.0;
    }
  }
  Random random;
  bovw::WordGrid grid;
  ScoreModel model;
  std::vector<const bovw::WordGrid*> grids = {&grid};
};

TEST_F(PartScorer, FindsThePlaceOfEachPart) {
  const auto scores = score_parts(model, grids, {}, PriorMode::kOff, {}, 1);
  ASSERT_EQ(scores.maps.size(), 4u);
  for (int p = 0; p < 4; ++p) {
    const std::string name = "part " + std::to_string(p);
    EXPECT_EQ(scores.maps[static_cast<std::size_t>(p)].part, name);
    const auto best = std::find_if(scores.candidates.begin(), scores.candidates.end(),
                                   [&](const Candidate& c) { return c.part == name; });
    ASSERT_NE(best, scores.candidates.end());
    EXPECT_NEAR(best->column, 14 + 12 * (p % 2), 2);
    EXPECT_NEAR(best->row, 11 + 8 * (p / 2), 2);
    EXPECT_EQ(best->prior, 1.0);
  }
}

TEST_F(PartScorer, SameOnAnyNumberOfThreads) {
  const auto one = score_parts(model, grids, {}, PriorMode::kOff, {}, 1);
  const auto many = score_parts(model, grids, {}, PriorMode::kOff, {}, 3);
  ASSERT_EQ(one.candidates.size(), many.candidates.size());
  for (std::size_t i = 0; i < one.candidates.size(); ++i) {
    EXPECT_EQ(one.candidates[i].part, many.candidates[i].part);
    EXPECT_EQ(one.candidates[i].column, many.candidates[i].column);
    EXPECT_EQ(one.candidates[i].probability, many.candidates[i].probability);
  }
  for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(one.maps[i].values, many.maps[i].values);
}

TEST_F(PartScorer, PriorDecidesWhatIsSearchedAndWeighed) {
  const std::vector<PartPrior> priors = {{"part 1", 0.25, 0.5, false}, {"part 2", 0.75, 0.5, true}};
  const auto parts_of = [](const PartScores& scores) {
    std::vector<std::string> names;
    for (const auto& map : scores.maps) names.push_back(map.part);
    return names;
  };
  const auto prior_of = [](const PartScores& scores, const std::string& name) {
    for (const auto& candidate : scores.candidates) {
      if (candidate.part == name) return candidate.prior;
    }
    return -1.0;
  };
  const auto off = score_parts(model, grids, priors, PriorMode::kOff, {}, 1);
  EXPECT_EQ(parts_of(off).size(), 4u);
  EXPECT_EQ(prior_of(off, "part 1"), 1.0);
  const auto soft = score_parts(model, grids, priors, PriorMode::kSoft, {}, 1);
  EXPECT_EQ(parts_of(soft).size(), 4u);
  EXPECT_EQ(prior_of(soft, "part 0"), 1.0);
  EXPECT_EQ(prior_of(soft, "part 1"), 0.25);
  EXPECT_EQ(prior_of(soft, "part 2"), 0.75);
  const auto hard = score_parts(model, grids, priors, PriorMode::kHard, {}, 1);
  EXPECT_EQ(parts_of(hard), (std::vector<std::string>{"part 0", "part 2", "part 3"}));
  EXPECT_EQ(prior_of(hard, "part 1"), -1.0);
  EXPECT_EQ(prior_of(hard, "part 2"), 1.0);
}

}  // namespace
}  // namespace weft::detector
