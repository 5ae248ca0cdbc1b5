#include <gtest/gtest.h>

#include "base/error.hpp"
#include "descriptor/dense_descriptor.hpp"

namespace weft::descriptor {
namespace {

TEST(Grid, HasThePointsOfThePaperAt640x480) {
  const Grid grid = make_grid(640, 480, {});
  EXPECT_EQ(grid.columns, 105);
  EXPECT_EQ(grid.rows, 78);
  EXPECT_EQ(grid.x(0), 6);
  EXPECT_EQ(grid.x(104), 630);
}

TEST(Grid, EveryPointKeepsTheBorder) {
  for (int size = 0; size < 60; ++size) {
    for (int border = 0; border < 9; ++border) {
      const Grid grid = make_grid(size, 100, {5, border});
      if (grid.columns > 0) {
        EXPECT_LE(grid.x(grid.columns - 1), size - 1 - border);
      }
      EXPECT_GT(grid.x(grid.columns), size - 1 - border);  // the next one would not
    }
  }
}

TEST(Grid, RefusesImpossibleOptions) { EXPECT_THROW(make_grid(640, 480, {0, 6}), Error); }

}  // namespace
}  // namespace weft::descriptor
