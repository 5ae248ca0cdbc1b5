#include "bovw/histogram.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"

namespace weft::bovw {
namespace {

// Clamped before the conversion, which must not overflow.
int to_cell(double value) { return static_cast<int>(std::clamp(value, -1e6, 1e6)); }

void check_counts(const WordGrid& grid, std::span<std::int32_t> counts) {
  if (counts.size() != static_cast<std::size_t>(grid.vocabulary_size)) {
    throw Error("histogram of " + std::to_string(counts.size()) + " entries for a vocabulary of " +
                std::to_string(grid.vocabulary_size) + " words");
  }
}

}  // namespace

CellBox cells_in_box(const WordGrid& grid, double x, double y, double width, double height) {
  const auto cell = [&](double px, double origin) {
    return to_cell(std::ceil((px - origin) / grid.step_px));
  };
  const int column = cell(x, grid.origin_x), row = cell(y, grid.origin_y);
  return {column, row, std::max(0, cell(x + width, grid.origin_x) - column),
          std::max(0, cell(y + height, grid.origin_y) - row)};
}

int window_cells(double size_px, double step_px) {
  return std::max(1, to_cell(std::floor(size_px / step_px + 0.5)));
}

int count_words(const WordGrid& grid, const CellBox& box, std::span<std::int32_t> counts) {
  check_counts(grid, counts);
  std::fill(counts.begin(), counts.end(), 0);
  const int column_end = std::min(grid.columns, box.column + box.columns);
  const int row_end = std::min(grid.rows, box.row + box.rows);
  int total = 0;
  for (int row = std::max(0, box.row); row < row_end; ++row) {
    for (int column = std::max(0, box.column); column < column_end; ++column) {
      const int word = grid.at(column, row);
      if (word < 0) continue;
      ++counts[static_cast<std::size_t>(word)];
      ++total;
    }
  }
  return total;
}

int count_words(const WordGrid& grid, std::span<std::int32_t> counts) {
  return count_words(grid, {0, 0, grid.columns, grid.rows}, counts);
}

CellBox mask_bounds(const WordGrid& grid) {
  int left = grid.columns, right = -1, top = grid.rows, bottom = -1;
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      if (grid.at(column, row) == WordGrid::kOutsideMask) continue;
      left = std::min(left, column);
      right = std::max(right, column);
      top = std::min(top, row);
      bottom = std::max(bottom, row);
    }
  }
  if (right < 0) return {};
  return {left, top, right - left + 1, bottom - top + 1};
}

}  // namespace weft::bovw
