#include "bovw/histogram.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::bovw {
namespace {

WordGrid random_grid(std::uint64_t seed) {
  Random random(seed);
  WordGrid grid;
  grid.vocabulary_size = 5;
  grid.origin_x = 6;
  grid.origin_y = 9;
  grid.step_px = 6;
  grid.columns = 13;
  grid.rows = 9;
  for (int i = 0; i < 13 * 9; ++i)
    grid.cells.push_back(static_cast<std::int16_t>(random.integer(-2, 4)));
  return grid;
}

TEST(Histogram, CountsTheWordsOfPointsInsideTheBox) {
  const auto grid = random_grid(1);
  Random random(2);
  for (int run = 0; run < 200; ++run) {
    const double x = random.uniform(-30, 100), y = random.uniform(-30, 80);
    const double width = random.uniform(0, 90), height = random.uniform(0, 90);
    std::vector<std::int32_t> expected(5, 0), counts(5, 99);
    int total = 0;
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        const double px = 6 + 6 * column, py = 9 + 6 * row;
        if (px < x || px >= x + width || py < y || py >= y + height) continue;
        if (grid.at(column, row) < 0) continue;
        ++expected[static_cast<std::size_t>(grid.at(column, row))];
        ++total;
      }
    }
    EXPECT_EQ(count_words(grid, cells_in_box(grid, x, y, width, height), counts), total);
    EXPECT_EQ(counts, expected);
  }
  std::vector<std::int32_t> four(4);
  EXPECT_THROW(count_words(grid, four), Error);
}

TEST(Histogram, AWindowsCellsAreThoseOfItsBox) {
  const auto grid = random_grid(3);
  EXPECT_EQ(window_cells(60, 6), 10);
  EXPECT_EQ(window_cells(62.9, 6), 10);
  EXPECT_EQ(window_cells(63, 6), 11);
  EXPECT_EQ(window_cells(0.1, 6), 1);
  // The box of a window of 3 x 2 points from (4, 5), as the header gives it.
  EXPECT_EQ(cells_in_box(grid, 6 + 3.5 * 6, 9 + 4.5 * 6, 18, 12), (CellBox{4, 5, 3, 2}));
  EXPECT_EQ(cells_in_box(grid, 1e300, 0, 1e300, 5).columns, 0);
}

TEST(Histogram, MaskBoundsHoldEveryPointInsideTheMask) {
  auto grid = random_grid(4);
  std::fill(grid.cells.begin(), grid.cells.end(), WordGrid::kOutsideMask);
  EXPECT_EQ(mask_bounds(grid), CellBox{});
  grid.cells[2 * 13 + 7] = WordGrid::kNoWord;
  EXPECT_EQ(mask_bounds(grid), (CellBox{7, 2, 1, 1}));
  grid.cells[6 * 13 + 3] = 1;
  EXPECT_EQ(mask_bounds(grid), (CellBox{3, 2, 5, 5}));
}

}  // namespace
}  // namespace weft::bovw
