#include "messages/maps.hpp"

#include <algorithm>
#include <cmath>

#include "messages/view.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

std::vector<std::uint8_t> reduced(const std::vector<std::uint8_t>& values, int columns, int rows,
                                  int factor) {
  const int out_columns = (columns + factor - 1) / factor;
  const int out_rows = (rows + factor - 1) / factor;
  std::vector<std::uint8_t> out(static_cast<std::size_t>(out_columns * out_rows), 0);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      auto& most = out[static_cast<std::size_t>(row / factor * out_columns + column / factor)];
      most = std::max(most, values[static_cast<std::size_t>(row * columns + column)]);
    }
  }
  return out;
}

}  // namespace

void to_message(const std::vector<detector::ProbabilityMap>& maps, const bovw::WordGrid& grid,
                probability_map_t& message) {
  const auto along = [](int points, int factor) { return (points + factor - 1) / factor; };
  int factor = 1;
  while (std::int64_t{along(grid.columns, factor)} * along(grid.rows, factor) *
             static_cast<std::int64_t>(maps.size()) >
         kMaxMapValues) {
    ++factor;
  }
  message.view = to_message(grid.view);
  message.step_px = grid.step_px * factor;
  message.origin_x = grid.origin_x + 0.5 * (factor - 1) * grid.step_px;
  message.origin_y = grid.origin_y + 0.5 * (factor - 1) * grid.step_px;
  message.columns = along(grid.columns, factor);
  message.rows = along(grid.rows, factor);
  message.maps.clear();
  for (const auto& map : maps) {
    if (map.values.size() != grid.cells.size())
      throw Error("probability map of " + map.part + ": not of the word grid's size");
    part_map_t m;
    m.part = map.part;
    m.full_scale = map.full_scale;
    m.values = factor == 1 ? map.values : reduced(map.values, grid.columns, grid.rows, factor);
    m.value_count = static_cast<std::int32_t>(m.values.size());
    message.maps.push_back(std::move(m));
  }
  message.map_count = static_cast<std::int32_t>(message.maps.size());
}

MapsContent from_message(const probability_map_t& message) {
  const auto fail = [](const std::string& what) {
    throw stage::InvalidInput("PROBABILITY_MAP: " + what);
  };
  MapsContent content;
  content.view = from_message(message.view, "PROBABILITY_MAP");
  content.origin_x = message.origin_x;
  content.origin_y = message.origin_y;
  content.step_px = message.step_px;
  content.columns = message.columns;
  content.rows = message.rows;
  if (!std::isfinite(message.origin_x) || !std::isfinite(message.origin_y) ||
      !(message.step_px > 0.0) || !std::isfinite(message.step_px)) {
    fail("the grid's origin or step is impossible");
  }
  const std::int64_t points = std::int64_t{message.columns} * message.rows;
  if (message.columns < 0 || message.rows < 0) fail("a grid of negative size");
  for (const auto& m : message.maps) {
    if (std::find(detector::kParts.begin(), detector::kParts.end(), m.part) ==
        detector::kParts.end()) {
      fail("unknown part '" + m.part.substr(0, 64) + "'");
    }
    for (const auto& other : content.maps) {
      if (other.part == m.part) fail(m.part + " is named twice");
    }
    if (m.value_count != points || static_cast<std::int64_t>(m.values.size()) != points)
      fail("the map of " + m.part + " is not of the grid's size");
    if (!(m.full_scale >= 0.0 && m.full_scale <= 1.0))
      fail("the scale of " + m.part + " is outside 0 to 1");
    content.maps.push_back({m.part, m.full_scale, m.values});
  }
  return content;
}

}  // namespace weft::messages
