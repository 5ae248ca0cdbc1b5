#include "detector/window_scorer.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <filesystem>
#include <limits>

#include "base/error.hpp"
#include "lib/detector/random_words.hpp"

namespace weft::detector {
namespace {

std::uint64_t bits(double value) { return std::bit_cast<std::uint64_t>(value); }

// Every window on its own: histograms by a loop over its cells, the definition of its score.
void expect_brute_force(const ScoreModel& model, const std::vector<const bovw::WordGrid*>& grids,
                        int part, const WindowShape& shape) {
  const WindowScorer scorer(model, grids);
  const auto windows = scorer.score(part, shape);
  const auto& grid = *grids.front();
  EXPECT_EQ(windows.window_columns, bovw::window_cells(shape.width_px, grid.step_px));
  EXPECT_EQ(windows.window_rows, bovw::window_cells(shape.height_px, grid.step_px));
  int left = 1 << 30, right = -1, top = 1 << 30, bottom = -1;
  for (const auto* each : grids) {
    const auto box = bovw::mask_bounds(*each);
    if (box.columns == 0) continue;
    left = std::min(left, box.column);
    top = std::min(top, box.row);
    right = std::max(right, box.column + box.columns);
    bottom = std::max(bottom, box.row + box.rows);
  }
  if (right < 0) {
    EXPECT_TRUE(windows.scores.empty());
    return;
  }
  ASSERT_EQ(windows.positions,
            (bovw::CellBox{left - windows.window_columns / 2, top - windows.window_rows / 2,
                           right - left, bottom - top}));
  std::size_t i = 0;
  for (int r = 0; r < windows.positions.rows; ++r) {
    for (int c = 0; c < windows.positions.columns; ++c, ++i) {
      std::vector<std::vector<std::int32_t>> counts;
      int total = 0;
      for (std::size_t b = 0; b < grids.size(); ++b) {
        const auto* each = grids[b];
        const auto words = static_cast<std::size_t>(each->vocabulary_size);
        const bool context = model.blocks[b].context;
        counts.emplace_back(words + (context ? 2 : 0), 0);
        for (int y = 0; y < windows.window_rows; ++y) {
          for (int x = 0; x < windows.window_columns; ++x) {
            const int column = windows.positions.column + c + x,
                      row = windows.positions.row + r + y;
            const bool on_grid =
                column >= 0 && row >= 0 && column < each->columns && row < each->rows;
            const int word = on_grid ? each->at(column, row) : bovw::WordGrid::kOutsideMask;
            if (word >= 0) {
              ++counts.back()[static_cast<std::size_t>(word)];
              ++total;
            } else if (context) {
              ++counts.back()[words + (word == bovw::WordGrid::kNoWord ? 0 : 1)];
            }
          }
        }
      }
      const double expected = window_score(model, part, counts);
      if (total < model.min_words) {
        ASSERT_TRUE(std::isnan(expected) && std::isnan(windows.scores[i]));
      } else {
        ASSERT_EQ(bits(windows.scores[i]), bits(expected))
            << windows.scores[i] << " " << expected << " at " << c << ", " << r;
      }
    }
  }
  EXPECT_EQ(i, windows.scores.size());
}

TEST(WindowScorer, EqualsBruteForceBitForBit) {
  Random random(1);
  for (const auto norm : {HistogramNorm::kSqrtL2, HistogramNorm::kL1, HistogramNorm::kRaw}) {
    for (int run = 0; run < 12; ++run) {
      const int columns = static_cast<int>(random.integer(1, 40));
      const int rows = static_cast<int>(random.integer(1, 40));
      const int words = static_cast<int>(random.integer(1, 300));
      const auto sift =
          random_words("sift", columns, rows, words, random, random.uniform(0.0, 0.6));
      const auto fpfh = random_words("fpfh", columns, rows, 17, random, random.uniform(0.0, 0.6));
      std::vector<WindowShape> shapes;
      for (int i = 0; i < 4; ++i)
        shapes.push_back({random.uniform(1, 200), random.uniform(1, 200)});
      for (const bool two : {false, true}) {
        std::vector<const bovw::WordGrid*> grids = {&sift};
        if (two) grids.push_back(&fpfh);
        auto model = random_model(grids, 1, shapes, random, run % 2 == 0);
        model.norm = norm;
        model.min_words = static_cast<int>(random.integer(1, 8));
        for (const auto& shape : shapes) expect_brute_force(model, grids, 0, shape);
      }
    }
  }
}

// The largest weights and long runs of one word: no sum may wrap around.
TEST(WindowScorer, HoldsTheLargestSums) {
  Random random(2);
  auto grid = random_words("sift", 60, 60, 3, random, 1.0);
  for (auto& cell : grid.cells) {
    if (cell >= 0 && random.uniform() < 0.9) cell = 1;
  }
  const std::vector<WindowShape> shapes = {{360, 360}, {360, 12}, {6, 360}};
  auto model = random_model({&grid}, 1, shapes, random);
  model.parts[0].weights[0] = {kMaxWeight, kMaxWeight, -kMaxWeight};
  for (const auto norm : {HistogramNorm::kSqrtL2, HistogramNorm::kL1, HistogramNorm::kRaw}) {
    model.norm = norm;
    for (const auto& shape : shapes) expect_brute_force(model, {&grid}, 0, shape);
  }
}

// The score is the logistic regression's: sqrt of counts, L2, times the weights, plus the bias.
TEST(WindowScorer, ScoreIsTheDotProductOfTheNormalisedHistogram) {
  Random random(3);
  const auto a = random_words("sift", 20, 20, 30, random);
  const auto b = random_words("fpfh", 20, 20, 10, random);
  for (const auto norm : {HistogramNorm::kSqrtL2, HistogramNorm::kL1, HistogramNorm::kRaw}) {
    auto model = random_model({&a, &b}, 1, {{60, 60}}, random);
    model.norm = norm;
    std::vector<std::vector<std::int32_t>> counts(2);
    for (int i = 0; i < 30; ++i) counts[0].push_back(static_cast<std::int32_t>(random.below(20)));
    for (int i = 0; i < 10; ++i) counts[1].push_back(static_cast<std::int32_t>(random.below(5)));
    double expected = model.parts[0].bias;
    for (std::size_t block = 0; block < 2; ++block) {
      std::vector<double> x;
      double norm1 = 0, norm2 = 0;
      for (const int count : counts[block]) {
        x.push_back(norm == HistogramNorm::kSqrtL2 ? std::sqrt(count) : count);
        norm1 += x.back();
        norm2 += x.back() * x.back();
      }
      const double divisor = norm == HistogramNorm::kSqrtL2 ? std::sqrt(norm2)
                             : norm == HistogramNorm::kL1   ? norm1
                                                            : 1.0;
      for (std::size_t i = 0; i < x.size(); ++i)
        expected += x[i] / divisor * model.parts[0].weights[block][i] / 65536.0;
    }
    EXPECT_NEAR(window_score(model, 0, counts), expected, 1e-4);
    // An empty block adds nothing; too few words are no window at all.
    std::fill(counts[1].begin(), counts[1].end(), 0);
    EXPECT_TRUE(std::isfinite(window_score(model, 0, counts)));
    std::fill(counts[0].begin(), counts[0].end(), 0);
    EXPECT_TRUE(std::isnan(window_score(model, 0, counts)));
  }
}

TEST(WindowScorer, RefusesGridsThatAreNotTheModels) {
  Random random(4);
  const auto grid = random_words("sift", 10, 10, 5, random);
  const auto other = random_words("fpfh", 10, 10, 5, random);
  const auto model = random_model({&grid}, 1, {{30, 30}}, random);
  const auto refused = [&](bovw::WordGrid changed) {
    const std::vector<const bovw::WordGrid*> grids = {&changed};
    EXPECT_THROW(WindowScorer(model, grids), Error);
  };
  const std::vector<const bovw::WordGrid*> good = {&grid}, none, both = {&grid, &other};
  EXPECT_NO_THROW(WindowScorer(model, good));
  EXPECT_THROW(WindowScorer(model, none), Error);
  EXPECT_THROW(WindowScorer(model, both), Error);
  refused(other);
  auto changed = grid;
  changed.vocabulary_hash ^= 1;
  refused(changed);
  changed = grid;
  changed.cells[3] = 5;
  refused(changed);
  changed = grid;
  changed.cells.pop_back();
  refused(changed);
  changed = grid;
  changed.step_px = 0.01;  // windows of 3000 points
  refused(changed);
  changed = other;
  changed.origin_x += 1;
  const auto two = random_model({&grid, &other}, 1, {{30, 30}}, random);
  const std::vector<const bovw::WordGrid*> shifted = {&grid, &changed};
  EXPECT_NO_THROW(WindowScorer(two, both));
  EXPECT_THROW(WindowScorer(two, shifted), Error);
}

TEST(ScoreModel, FileKeepsEverything) {
  Random random(5);
  const auto a = random_words("sift", 4, 4, 30, random);
  const auto b = random_words("fpfh", 4, 4, 10, random);
  auto model = random_model({&a, &b}, 3, {{60, 40.5}, {30, 90}}, random);
  model.norm = HistogramNorm::kL1;
  model.min_words = 9;
  const auto path = (std::filesystem::temp_directory_path() /
                     ("weft_score_model_" + std::to_string(getpid()) + ".weft"))
                        .string();
  model.write(path);
  const auto read = ScoreModel::read(path);
  EXPECT_EQ(read.norm, model.norm);
  EXPECT_EQ(read.min_words, 9);
  ASSERT_EQ(read.blocks.size(), 2u);
  EXPECT_EQ(read.blocks[1].descriptor, "fpfh");
  EXPECT_EQ(read.blocks[1].vocabulary_hash, model.blocks[1].vocabulary_hash);
  ASSERT_EQ(read.parts.size(), 3u);
  for (std::size_t p = 0; p < 3; ++p) {
    EXPECT_EQ(read.parts[p].part, model.parts[p].part);
    EXPECT_EQ(read.parts[p].weights, model.parts[p].weights);
    EXPECT_EQ(read.parts[p].bias, model.parts[p].bias);
    ASSERT_EQ(read.parts[p].shapes.size(), 2u);
    EXPECT_EQ(read.parts[p].shapes[0].height_px, 40.5);
  }
  EXPECT_NE(read.hash, 0u);
  std::filesystem::remove(path);
  model.parts[1].weights[0].pop_back();
  EXPECT_THROW(model.write(path), Error);
}

TEST(ScoreModel, QuantisesWeightsAndRefusesWhatDoesNotFit) {
  EXPECT_EQ(quantise_weights(std::vector<double>{0.5, -1.0, 1024.0, 1e-9}),
            (std::vector<std::int32_t>{32768, -65536, kMaxWeight, 0}));
  EXPECT_THROW(quantise_weights(std::vector<double>{1025.0}), Error);
  EXPECT_THROW(quantise_weights(std::vector<double>{std::nan("")}), Error);
  EXPECT_THROW(quantise_weights(std::vector<double>{std::numeric_limits<double>::infinity()}),
               Error);
}

}  // namespace
}  // namespace weft::detector
