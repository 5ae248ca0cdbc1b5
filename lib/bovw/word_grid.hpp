#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rgbd/view.hpp"

namespace weft::bovw {

/// One visual word for each point of a regular grid over a view. Prior, scorer and refiner need
/// nothing else.
struct WordGrid {
  static constexpr std::int16_t kOutsideMask = -2;
  static constexpr std::int16_t kNoWord = -1;  // inside the mask, but nothing to describe

  std::string descriptor;  // "sift", "fpfh", ...
  std::uint64_t vocabulary_hash = 0;
  int vocabulary_size = 0;  // words are 0 .. vocabulary_size - 1
  rgbd::View view;
  double origin_x = 0.0;  // view px of the first grid point
  double origin_y = 0.0;
  double step_px = 6.0;  // view px between grid points
  int columns = 0;
  int rows = 0;
  std::vector<std::int16_t> cells;  // row-major, columns * rows

  std::int16_t at(int column, int row) const {
    return cells[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                 static_cast<std::size_t>(column)];
  }
};

}  // namespace weft::bovw
