#include "detector/prior.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/det_math.hpp"
#include "base/error.hpp"

namespace weft::detector {

void PriorModel::validate() const {
  const auto fail = [&](const std::string& what) {
    throw Error("image-level prior of " + part + ": " + what);
  };
  if (std::find(kParts.begin(), kParts.end(), part) == kParts.end()) fail("unknown part");
  int words = 0;
  for (const int n : block_words) {
    if (n < 1 || n > 32767) fail("vocabulary of " + std::to_string(n) + " words");
    words += n;
  }
  if (words == 0 || static_cast<int>(weights.size()) != words) fail("weights do not fit the words");
  if (!std::isfinite(bias) ||
      !std::all_of(weights.begin(), weights.end(), [](double w) { return std::isfinite(w); })) {
    fail("a weight is not finite");
  }
  if (!(threshold >= 0.0 && threshold <= 1.0)) fail("the threshold is not a probability");
}

std::vector<double> image_histogram(const std::vector<const bovw::WordGrid*>& grids) {
  std::vector<double> histogram;
  for (const auto* grid : grids) {
    std::vector<int> counts(static_cast<std::size_t>(grid->vocabulary_size), 0);
    for (const auto cell : grid->cells) {
      if (cell >= 0) ++counts[static_cast<std::size_t>(cell)];
    }
    const int total = std::accumulate(counts.begin(), counts.end(), 0);
    for (const int count : counts) {
      histogram.push_back(total > 0 ? std::sqrt(static_cast<double>(count) / total) : 0.0);
    }
  }
  return histogram;
}

ImagePrior::ImagePrior(std::vector<PriorModel> models) : models_(std::move(models)) {
  for (const auto& model : models_) model.validate();
}

std::vector<PartPrior> ImagePrior::evaluate(const std::vector<const bovw::WordGrid*>& grids,
                                            PriorMode mode) const {
  std::vector<int> block_words;
  for (const auto* grid : grids) block_words.push_back(grid->vocabulary_size);
  const auto histogram = image_histogram(grids);
  std::vector<PartPrior> priors;
  for (const auto& model : models_) {
    if (model.block_words != block_words) {
      throw Error("the words do not fit the image-level prior of " + model.part +
                  ": other vocabulary sizes");
    }
    double sum = model.bias;
    for (std::size_t w = 0; w < histogram.size(); ++w) sum += model.weights[w] * histogram[w];
    PartPrior prior;
    prior.part = model.part;
    prior.probability = det::logistic(sum);
    prior.threshold = model.threshold;
    prior.searched = mode != PriorMode::kHard || prior.probability >= model.threshold;
    priors.push_back(prior);
  }
  return priors;
}

}  // namespace weft::detector
