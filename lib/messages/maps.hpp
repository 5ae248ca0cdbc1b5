#pragma once

#include <vector>

#include "bovw/word_grid.hpp"
#include "detector/types.hpp"
#include "weft/probability_map_t.hpp"

/// PROBABILITY_MAP to and from the detector's maps.
namespace weft::messages {

/// Values of all maps together; more would not fit a message (160 KB) beside the rest of it.
constexpr int kMaxMapValues = 150'000;

/// Maps with the grid they lie on.
struct MapsContent {
  rgbd::View view;
  double origin_x = 0.0;  // view px of the first value
  double origin_y = 0.0;
  double step_px = 0.0;
  int columns = 0;
  int rows = 0;
  std::vector<detector::ProbabilityMap> maps;
};

/// Fills in everything but header and status. Maps on the points of the word grid; where they would
/// not fit a message, the largest value of each 2 x 2 (3 x 3, ...) points stands for them, in their
/// middle.
void to_message(const std::vector<detector::ProbabilityMap>& maps, const bovw::WordGrid& grid,
                probability_map_t& message);

/// Throws stage::InvalidInput for unknown parts, parts named twice, sizes that do not agree and
/// scales outside 0 to 1.
MapsContent from_message(const probability_map_t& message);

}  // namespace weft::messages
