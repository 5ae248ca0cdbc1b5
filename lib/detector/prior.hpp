#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "bovw/word_grid.hpp"
#include "detector/blocks.hpp"
#include "detector/types.hpp"

/// The image-level prior (papers/garment-parts.txt section 3.4): for each part the probability that
/// the image shows it at all, by logistic regression on the words of the whole mask.
namespace weft::detector {

struct PartPriorModel {
  std::string part;
  std::vector<double> weights;  // one a word, block after block
  double bias = 0.0;
  double threshold = 0.0;  // on the probability; chosen by cross-validation
};

struct PriorModel {
  std::vector<HistogramBlock> blocks;
  std::vector<PartPriorModel> parts;
  std::uint64_t hash = 0;  // set by read()

  /// Throws Error naming `where`, the part and the rule that is broken.
  void validate(const std::string& where) const;
  static PriorModel read(const std::string& path);
  void write(const std::string& path) const;
};

/// Words of the whole grid: square root of each word's share of its descriptor's words, so that
/// each descriptor's block has length 1, or 0 when it has no words.
std::vector<double> image_histogram(std::span<const bovw::WordGrid* const> grids);

/// One answer a part, in the model's order. `searched` is false only in mode hard and below the
/// threshold. Throws Error when the grids do not fit the model.
std::vector<PartPrior> evaluate_prior(const PriorModel& model,
                                      std::span<const bovw::WordGrid* const> grids, PriorMode mode);

}  // namespace weft::detector
