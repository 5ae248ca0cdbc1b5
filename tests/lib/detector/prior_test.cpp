#include "detector/prior.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"

namespace weft::detector {
namespace {

bovw::WordGrid grid_of(std::vector<std::int16_t> cells, int words) {
  bovw::WordGrid grid;
  grid.vocabulary_size = words;
  grid.columns = static_cast<int>(cells.size());
  grid.rows = 1;
  grid.cells = std::move(cells);
  return grid;
}

PriorModel hips() {
  PriorModel model;
  model.part = "jeans hips";
  model.block_words = {2, 3};
  model.weights = {1.0, -2.0, 0.5, 0.25, 3.0};
  model.bias = -0.75;
  model.threshold = 0.4;
  return model;
}

TEST(ImagePrior, HandWorked) {
  const auto a = grid_of({-2, 0, 0, 0, 1, -1}, 2);  // shares 3/4, 1/4
  const auto b = grid_of({-2, 2, -1, -1, -1, -1}, 3);
  const ImagePrior prior({hips()});
  const auto answer = prior.evaluate({&a, &b}, PriorMode::kHard);
  ASSERT_EQ(answer.size(), 1u);
  const double z = std::sqrt(0.75) * 1.0 + 0.5 * -2.0 + 3.0 - 0.75;
  EXPECT_NEAR(answer[0].probability, 1.0 / (1.0 + std::exp(-z)), 1e-15);
  EXPECT_TRUE(answer[0].searched);
}

TEST(ImagePrior, OnlyModeHardLeavesAPartOut) {
  const auto a = grid_of({1, 1}, 2);
  const auto b = grid_of({-1, -2}, 3);  // no words: the block is zero
  const ImagePrior prior({hips()});
  const double p = 1.0 / (1.0 + std::exp(2.75));
  for (const auto mode : {PriorMode::kOff, PriorMode::kSoft, PriorMode::kHard}) {
    const auto answer = prior.evaluate({&a, &b}, mode);
    EXPECT_NEAR(answer[0].probability, p, 1e-15);
    EXPECT_EQ(answer[0].searched, mode != PriorMode::kHard);
  }
}

TEST(ImagePrior, RefusesWhatDoesNotFit) {
  const auto a = grid_of({1, 1}, 2);
  EXPECT_THROW(ImagePrior({hips()}).evaluate({&a}, PriorMode::kOff), Error);
  auto model = hips();
  model.weights.pop_back();
  EXPECT_THROW(ImagePrior({model}), Error);
  model = hips();
  model.part = "sock toe";
  EXPECT_THROW(ImagePrior({model}), Error);
  model = hips();
  model.threshold = 1.5;
  EXPECT_THROW(ImagePrior({model}), Error);
  model = hips();
  model.bias = std::nan("");
  EXPECT_THROW(ImagePrior({model}), Error);
}

}  // namespace
}  // namespace weft::detector
