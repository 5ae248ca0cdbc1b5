#include "detector/prior.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"
#include "support/files.hpp"

namespace weft::detector {
namespace {

bovw::WordGrid grid_of(std::vector<std::int16_t> cells, int words) {
  bovw::WordGrid grid;
  grid.descriptor = "d" + std::to_string(words);
  grid.vocabulary_hash = 77;
  grid.vocabulary_size = words;
  grid.columns = static_cast<int>(cells.size());
  grid.rows = 1;
  grid.cells = std::move(cells);
  return grid;
}

PriorModel hips() {
  PriorModel model;
  model.blocks = {{"d2", 77, 2}, {"d3", 77, 3}};
  PartPriorModel part;
  part.part = "jeans hips";
  part.weights = {1.0, -2.0, 0.5, 0.25, 3.0};
  part.bias = -0.75;
  part.threshold = 0.4;
  model.parts = {part};
  return model;
}

TEST(ImagePrior, HandWorked) {
  const auto a = grid_of({-2, 0, 0, 0, 1, -1}, 2);  // shares 3/4, 1/4
  const auto b = grid_of({-2, 2, -1, -1, -1, -1}, 3);
  const bovw::WordGrid* const grids[] = {&a, &b};
  const auto answer = evaluate_prior(hips(), grids, PriorMode::kHard);
  ASSERT_EQ(answer.size(), 1u);
  const double z = std::sqrt(0.75) * 1.0 + 0.5 * -2.0 + 3.0 - 0.75;
  EXPECT_NEAR(answer[0].probability, 1.0 / (1.0 + std::exp(-z)), 1e-15);
  EXPECT_EQ(answer[0].threshold, 0.4);
  EXPECT_TRUE(answer[0].searched);
}

TEST(ImagePrior, OnlyModeHardLeavesAPartOut) {
  const auto a = grid_of({1, 1}, 2);
  const auto b = grid_of({-1, -2}, 3);  // no words: the block is zero
  const bovw::WordGrid* const grids[] = {&a, &b};
  const double p = 1.0 / (1.0 + std::exp(2.75));
  for (const auto mode : {PriorMode::kOff, PriorMode::kSoft, PriorMode::kHard}) {
    const auto answer = evaluate_prior(hips(), grids, mode);
    EXPECT_NEAR(answer[0].probability, p, 1e-15);
    EXPECT_EQ(answer[0].searched, mode != PriorMode::kHard);
  }
}

TEST(ImagePrior, RefusesGridsOfAnotherTraining) {
  const auto a = grid_of({1, 1}, 2), b = grid_of({1, 1}, 3), wider = grid_of({1, 1, 1}, 3);
  auto other = b;
  other.vocabulary_hash = 78;
  const auto evaluate = [](std::vector<const bovw::WordGrid*> grids) {
    return evaluate_prior(hips(), grids, PriorMode::kOff);
  };
  EXPECT_NO_THROW(evaluate({&a, &b}));
  EXPECT_THROW(evaluate({&a}), Error);
  EXPECT_THROW(evaluate({&b, &a}), Error);
  EXPECT_THROW(evaluate({&a, &other}), Error);
  EXPECT_THROW(evaluate({&a, &wider}), Error);
}

TEST(PriorModel, WritesAndReadsTheSame) {
  const test::TemporaryFolder folder;
  const auto path = folder / "prior.blob";
  hips().write(path);
  const auto read = PriorModel::read(path);
  EXPECT_NE(read.hash, 0u);
  ASSERT_EQ(read.parts.size(), 1u);
  EXPECT_EQ(read.parts[0].part, "jeans hips");
  EXPECT_EQ(read.parts[0].weights, hips().parts[0].weights);
  EXPECT_EQ(read.parts[0].bias, -0.75);
  EXPECT_EQ(read.parts[0].threshold, 0.4);
  EXPECT_EQ(read.blocks[1].words, 3);
}

TEST(PriorModel, RefusesWhatDoesNotFit) {
  for (int field = 0; field < 6; ++field) {
    auto model = hips();
    auto& part = model.parts[0];
    if (field == 0) part.weights.pop_back();
    if (field == 1) part.part = "sock toe";
    if (field == 2) part.threshold = 1.5;
    if (field == 3) part.bias = std::nan("");
    if (field == 4) model.blocks.clear();
    if (field == 5) model.parts.clear();
    EXPECT_THROW(model.validate("test"), Error) << field;
  }
}

}  // namespace
}  // namespace weft::detector
