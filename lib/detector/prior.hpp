#pragma once

#include <string>
#include <vector>

#include "bovw/word_grid.hpp"
#include "detector/types.hpp"

/// The image-level prior (papers/garment-parts.txt section 3.4): for each part the probability that
/// the image shows it at all, by logistic regression on the words of the whole mask.
namespace weft::detector {

struct PriorModel {
  std::string part;
  std::vector<int> block_words;  // vocabulary size of each descriptor
  std::vector<double> weights;   // one a word, descriptor after descriptor
  double bias = 0.0;
  double threshold = 0.0;  // on the probability; chosen by cross-validation

  /// Throws Error naming the part and the rule that is broken.
  void validate() const;
};

/// Words of the whole grid: square root of each word's share of its descriptor's words, so that
/// each descriptor's block has length 1, or 0 when it has no words.
std::vector<double> image_histogram(const std::vector<const bovw::WordGrid*>& grids);

class ImagePrior {
 public:
  explicit ImagePrior(std::vector<PriorModel> models);

  /// One answer a model, in their order. `searched` is false only in mode hard and below the
  /// threshold. Throws Error when the grids do not fit the models.
  std::vector<PartPrior> evaluate(const std::vector<const bovw::WordGrid*>& grids,
                                  PriorMode mode) const;

  const std::vector<PriorModel>& models() const { return models_; }

 private:
  std::vector<PriorModel> models_;
};

}  // namespace weft::detector
