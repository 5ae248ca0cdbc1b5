#pragma once

#include <cstdint>
#include <span>

#include "bovw/word_grid.hpp"

namespace weft::bovw {

/// A box of grid points; may reach beyond the grid, where there are no words.
struct CellBox {
  int column = 0;
  int row = 0;
  int columns = 0;
  int rows = 0;
  bool operator==(const CellBox&) const = default;
};

/// The grid points inside [x, x + width) x [y, y + height) view px.
CellBox cells_in_box(const WordGrid& grid, double x, double y, double width, double height);

/// Grid points along a window side of this many view px: round(size / step), at least 1. A window
/// of n grid points from column c spans [origin + (c - 1/2) step, origin + (c + n - 1/2) step).
int window_cells(double size_px, double step_px);

/// Counts the words of the box into counts (vocabulary_size entries, overwritten); returns their
/// sum.
int count_words(const WordGrid& grid, const CellBox& box, std::span<std::int32_t> counts);

/// Counts the words of the whole grid.
int count_words(const WordGrid& grid, std::span<std::int32_t> counts);

/// The smallest box that holds every point inside the mask; empty (0 x 0) when there is none.
CellBox mask_bounds(const WordGrid& grid);

}  // namespace weft::bovw
