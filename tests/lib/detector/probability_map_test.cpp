#include "detector/probability_map.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "detector/peaks.hpp"
#include "lib/detector/random_words.hpp"

namespace weft::detector {
namespace {

TEST(FixedProbability, IsTheLogisticWithinAUnit) {
  for (double score = -30; score < 30; score += 0.00317)
    EXPECT_NEAR(fixed_probability(score), 65536.0 / (1.0 + std::exp(-score)), 1.0) << score;
  EXPECT_EQ(fixed_probability(1e300), 65536);
  EXPECT_EQ(fixed_probability(-1e300), 0);
  EXPECT_EQ(fixed_probability(0.0), 32768);
}

// Mean over the windows that cover a point, each asked whether it does.
std::vector<double> brute_force(const WindowScorer& scorer, const ScoreModel& model) {
  const auto& grid = scorer.grid();
  std::vector<double> sum(grid.cells.size(), 0.0), cover(grid.cells.size(), 0.0);
  for (const auto& shape : model.parts[0].shapes) {
    const auto windows = scorer.score(0, shape);
    for (int r = 0; r < windows.positions.rows; ++r) {
      for (int c = 0; c < windows.positions.columns; ++c) {
        const double score =
            windows.scores[static_cast<std::size_t>(r * windows.positions.columns + c)];
        if (std::isnan(score)) continue;
        const int left = windows.positions.column + c, top = windows.positions.row + r;
        for (int row = 0; row < grid.rows; ++row) {
          for (int column = 0; column < grid.columns; ++column) {
            if (column < left || column >= left + windows.window_columns || row < top ||
                row >= top + windows.window_rows) {
              continue;
            }
            const auto cell = static_cast<std::size_t>(row * grid.columns + column);
            sum[cell] += 65536.0 / (1.0 + std::exp(-score));
            cover[cell] += 1;
          }
        }
      }
    }
  }
  for (std::size_t cell = 0; cell < sum.size(); ++cell) {
    const bool inside = grid.cells[cell] != bovw::WordGrid::kOutsideMask;
    sum[cell] = inside && cover[cell] > 0 ? sum[cell] / cover[cell] : 0.0;
  }
  return sum;
}

std::vector<double> smoothed(const std::vector<double>& in, const bovw::WordGrid& grid,
                             double sigma) {
  std::vector<double> out(in.size(), 0.0);
  const int radius = static_cast<int>(std::ceil(3 * sigma));
  double total = 0;
  for (int i = -radius; i <= radius; ++i) total += std::exp(-0.5 * i * i / (sigma * sigma));
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      const auto cell = static_cast<std::size_t>(row * grid.columns + column);
      if (grid.cells[cell] == bovw::WordGrid::kOutsideMask) continue;
      for (int dy = -radius; dy <= radius; ++dy) {
        for (int dx = -radius; dx <= radius; ++dx) {
          const int x = column + dx, y = row + dy;
          if (x < 0 || y < 0 || x >= grid.columns || y >= grid.rows) continue;
          out[cell] += in[static_cast<std::size_t>(y * grid.columns + x)] *
                       std::exp(-0.5 * (dx * dx + dy * dy) / (sigma * sigma)) / (total * total);
        }
      }
    }
  }
  return out;
}

TEST(ProbabilityMap, IsTheMaskedSmoothedMeanOfTheCoveringWindows) {
  Random random(1);
  for (int run = 0; run < 6; ++run) {
    const auto grid = random_words("sift", static_cast<int>(random.integer(5, 30)),
                                   static_cast<int>(random.integer(5, 30)), 20, random,
                                   random.uniform(0.02, 0.5));
    const auto model = random_model({&grid}, 1, {{60, 40}, {18, 90}, {7, 7}, {300, 300}}, random);
    const std::vector<const bovw::WordGrid*> grids = {&grid};
    const WindowScorer scorer(model, grids);
    MapOptions options;
    options.smoothing_sigma_px = 0.0;
    const auto raw = probability_map(scorer, 0, options);
    const auto expected = brute_force(scorer, model);
    ASSERT_EQ(raw.values.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) ASSERT_NEAR(raw.values[i], expected[i], 1.5);
    options.smoothing_sigma_px = 9.0;
    const auto smooth = probability_map(scorer, 0, options);
    const auto expected_smooth = smoothed(expected, grid, 9.0 / 6.0);
    for (std::size_t i = 0; i < expected.size(); ++i)
      ASSERT_NEAR(smooth.values[i], expected_smooth[i], 8.0);
  }
}

TEST(ProbabilityMap, MarginIsZero) {
  Random random(2);
  const auto grid = random_words("sift", 20, 15, 8, random, 10.0);  // the mask is everything
  const auto model = random_model({&grid}, 1, {{30, 30}}, random);
  const std::vector<const bovw::WordGrid*> grids = {&grid};
  MapOptions options;
  options.margin_px = 20.0;
  const auto map = probability_map(WindowScorer(model, grids), 0, options);
  for (int row = 0; row < 15; ++row) {
    for (int column = 0; column < 20; ++column) {
      const double x = 6 + 6 * column, y = 6 + 6 * row;
      const bool zero = x < 20 || y < 20 || x > grid.view.width - 21 || y > grid.view.height - 21;
      EXPECT_EQ(map.values[static_cast<std::size_t>(row * 20 + column)] == 0, zero);
    }
  }
}

TEST(ProbabilityMap, NothingInsideTheMaskIsAllZero) {
  Random random(3);
  auto grid = random_words("sift", 12, 9, 8, random);
  std::fill(grid.cells.begin(), grid.cells.end(), bovw::WordGrid::kOutsideMask);
  const auto model = random_model({&grid}, 1, {{30, 30}}, random);
  const std::vector<const bovw::WordGrid*> grids = {&grid};
  const auto map = probability_map(WindowScorer(model, grids), 0, {});
  EXPECT_EQ(map.values, std::vector<std::int32_t>(12 * 9, 0));
  EXPECT_EQ(to_probability_map(map, "p").full_scale, 1.0);
}

TEST(ProbabilityMap, EightBitsScaleToTheLargestValue) {
  const FixedMap map{4, 1, {0, 100, 16384, 8192}};
  const auto out = to_probability_map(map, "polo collar");
  EXPECT_EQ(out.part, "polo collar");
  EXPECT_EQ(out.full_scale, 0.25);
  EXPECT_EQ(out.values, (std::vector<std::uint8_t>{0, 2, 255, 128}));
}

TEST(Peaks, AreLocalMaximaBestFirstAndApart) {
  FixedMap map{12, 9, std::vector<std::int32_t>(12 * 9, 0)};
  const auto set = [&](int column, int row, std::int32_t value) {
    map.values[static_cast<std::size_t>(row * 12 + column)] = value;
  };
  set(2, 2, 30000);
  set(3, 2, 29000);  // beside the peak: no maximum
  set(5, 2, 20000);  // a maximum, but 18 px from a better one
  set(10, 7, 25000);
  set(0, 8, 1000);  // below the threshold
  set(8, 0, 10000);
  set(9, 0, 10000);  // plateau: the first counts
  PeakOptions options;
  options.min_distance_px = 24.0;
  options.min_probability = 0.05;
  options.max_peaks = 10;
  const auto peaks = find_peaks(map, "p", 6.0, options);
  ASSERT_EQ(peaks.size(), 3u);
  EXPECT_EQ(peaks[0].column, 2);
  EXPECT_EQ(peaks[0].row, 2);
  EXPECT_EQ(peaks[0].probability, 30000 / 65536.0);
  EXPECT_EQ(peaks[1].column, 10);
  EXPECT_EQ(peaks[1].row, 7);
  EXPECT_EQ(peaks[2].column, 8);
  EXPECT_EQ(peaks[2].part, "p");
  options.max_peaks = 2;
  EXPECT_EQ(find_peaks(map, "p", 6.0, options).size(), 2u);
  options.min_distance_px = 17.0;
  options.max_peaks = 10;
  EXPECT_EQ(find_peaks(map, "p", 6.0, options).size(), 4u);
}

}  // namespace
}  // namespace weft::detector
