#include "messages/words.hpp"

#include <cmath>

#include "messages/view.hpp"
#include "stage/stage.hpp"

namespace weft::messages {

void to_message(const bovw::WordGrid& grid, words_t& message) {
  message.descriptor = grid.descriptor;
  message.vocabulary_hash = static_cast<std::int64_t>(grid.vocabulary_hash);
  message.vocabulary_size = grid.vocabulary_size;
  message.view = to_message(grid.view);
  message.origin_x = grid.origin_x;
  message.origin_y = grid.origin_y;
  message.step_px = grid.step_px;
  message.columns = grid.columns;
  message.rows = grid.rows;
  message.cell_count = static_cast<std::int32_t>(grid.cells.size());
  message.cells = grid.cells;
}

bovw::WordGrid from_message(const words_t& message) {
  const std::string where = "WORDS of " + message.descriptor.substr(0, 64);
  const auto fail = [&](const std::string& what) {
    throw stage::InvalidInput(where + ": " + what);
  };
  if (message.descriptor.empty()) fail("the descriptor has no name");
  if (message.vocabulary_size < 1 || message.vocabulary_size > 32767)
    fail("a vocabulary of " + std::to_string(message.vocabulary_size) + " words");
  if (!std::isfinite(message.origin_x) || !std::isfinite(message.origin_y) ||
      !(message.step_px > 0.0) || !std::isfinite(message.step_px)) {
    fail("the grid's origin or step is impossible");
  }
  const std::int64_t points = std::int64_t{message.columns} * message.rows;
  if (message.columns < 0 || message.rows < 0 || points > (1 << 22) ||
      points != message.cell_count ||
      message.cells.size() != static_cast<std::size_t>(message.cell_count)) {
    fail("a grid of " + std::to_string(message.columns) + " x " + std::to_string(message.rows) +
         " points with " + std::to_string(message.cells.size()) + " cells");
  }
  for (const auto cell : message.cells) {
    if (cell < words_t::OUTSIDE_MASK || cell >= message.vocabulary_size)
      fail("word " + std::to_string(cell) + " is not in the vocabulary");
  }
  bovw::WordGrid grid;
  grid.descriptor = message.descriptor;
  grid.vocabulary_hash = static_cast<std::uint64_t>(message.vocabulary_hash);
  grid.vocabulary_size = message.vocabulary_size;
  grid.view = from_message(message.view, where);
  grid.origin_x = message.origin_x;
  grid.origin_y = message.origin_y;
  grid.step_px = message.step_px;
  grid.columns = message.columns;
  grid.rows = message.rows;
  grid.cells = message.cells;
  return grid;
}

}  // namespace weft::messages
