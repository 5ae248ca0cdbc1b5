#pragma once

#include <string>
#include <vector>

#include "base/random.hpp"
#include "detector/window_scorer.hpp"

/// Random word maps and models for the tests and benchmarks of the sliding window.
namespace weft::detector {

/// An elliptic garment with ragged edge and holes; words in runs, as on cloth, and points without.
inline bovw::WordGrid random_words(const std::string& descriptor, int columns, int rows, int words,
                                   Random& random, double mask_share = 0.45) {
  bovw::WordGrid grid;
  grid.descriptor = descriptor;
  grid.vocabulary_hash = 7u + static_cast<std::uint64_t>(words);
  grid.vocabulary_size = words;
  grid.origin_x = grid.origin_y = 6;
  grid.columns = columns;
  grid.rows = rows;
  grid.view.width = 12 + 6 * columns;
  grid.view.height = 12 + 6 * rows;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const double x = (column - columns / 2.0) / columns, y = (row - rows / 2.0) / rows;
      std::int16_t cell = bovw::WordGrid::kOutsideMask;
      if (x * x + y * y < mask_share + 0.05 * random.normal()) {
        cell = static_cast<std::int16_t>(random.below(static_cast<std::uint64_t>(words)));
        if (column > 0 && grid.cells.back() >= 0 && random.uniform() < 0.3)
          cell = grid.cells.back();
        if (random.uniform() < 0.1) cell = bovw::WordGrid::kNoWord;
      }
      grid.cells.push_back(cell);
    }
  }
  return grid;
}

inline ScoreModel random_model(const std::vector<const bovw::WordGrid*>& grids, int parts,
                               const std::vector<WindowShape>& shapes, Random& random,
                               bool context = false) {
  ScoreModel model;
  for (const auto* grid : grids) {
    model.blocks.push_back(
        {grid->descriptor, grid->vocabulary_hash, grid->vocabulary_size, context});
  }
  for (int p = 0; p < parts; ++p) {
    PartClassifier part;
    part.part = "part " + std::to_string(p);
    for (const auto& block : model.blocks) {
      std::vector<double> weights;
      for (int entry = 0; entry < block.entries(); ++entry) weights.push_back(3 * random.normal());
      part.weights.push_back(quantise_weights(weights));
    }
    part.bias = random.normal();
    part.shapes = shapes;
    model.parts.push_back(std::move(part));
  }
  return model;
}

}  // namespace weft::detector
