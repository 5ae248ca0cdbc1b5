#include "detector/prior.hpp"

#include <algorithm>
#include <cmath>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "bovw/histogram.hpp"

namespace weft::detector {

void PriorModel::validate(const std::string& where) const {
  validate_blocks(blocks, where);
  for (const auto& block : blocks) {
    if (block.context) throw Error(where + ": the image-level prior knows words only");
  }
  if (parts.empty()) throw Error(where + ": no parts");
  for (const auto& part : parts) {
    validate_part(part.part, where);
    const auto fail = [&](const std::string& what) {
      throw Error(where + ": " + part.part + ": " + what);
    };
    if (static_cast<int>(part.weights.size()) != total_entries(blocks)) {
      fail("weights do not fit the words");
    }
    if (!std::isfinite(part.bias) || !std::all_of(part.weights.begin(), part.weights.end(),
                                                  [](double w) { return std::isfinite(w); })) {
      fail("a weight is not finite");
    }
    if (!(part.threshold >= 0.0 && part.threshold <= 1.0)) {
      fail("the threshold is not a probability");
    }
  }
}

void PriorModel::write(const std::string& path) const {
  validate(path);
  BlobWriter blob("prior", 1);
  write_blocks(blob, blocks);
  blob.add_number("parts", static_cast<std::int64_t>(parts.size()));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::string name = "part." + std::to_string(i) + ".";
    blob.add(name + "name", parts[i].part);
    blob.add(name + "weights", std::span<const double>(parts[i].weights));
    blob.add_number(name + "bias", parts[i].bias);
    blob.add_number(name + "threshold", parts[i].threshold);
  }
  blob.write(path);
}

PriorModel PriorModel::read(const std::string& path) {
  const auto blob = BlobReader::from_file(path, "prior", 1);
  PriorModel model;
  model.blocks = read_blocks(blob);
  model.parts.resize(
      static_cast<std::size_t>(blob.integer("parts", 1, static_cast<int>(kParts.size()))));
  for (std::size_t i = 0; i < model.parts.size(); ++i) {
    const std::string name = "part." + std::to_string(i) + ".";
    model.parts[i].part = blob.text(name + "name");
    model.parts[i].weights = blob.values<double>(name + "weights");
    model.parts[i].bias = blob.number(name + "bias");
    model.parts[i].threshold = blob.number(name + "threshold");
  }
  model.hash = blob.hash();
  model.validate(path);
  return model;
}

std::vector<double> image_histogram(std::span<const bovw::WordGrid* const> grids) {
  std::vector<double> histogram;
  for (const auto* grid : grids) {
    std::vector<std::int32_t> counts(static_cast<std::size_t>(grid->vocabulary_size));
    const int total = bovw::count_words(*grid, counts);
    for (const auto count : counts) {
      histogram.push_back(total > 0 ? std::sqrt(static_cast<double>(count) / total) : 0.0);
    }
  }
  return histogram;
}

std::vector<PartPrior> evaluate_prior(const PriorModel& model,
                                      std::span<const bovw::WordGrid* const> grids,
                                      PriorMode mode) {
  check_grids(model.blocks, grids, "image-level prior");
  const auto histogram = image_histogram(grids);
  std::vector<PartPrior> priors;
  for (const auto& part : model.parts) {
    double sum = part.bias;
    for (std::size_t w = 0; w < histogram.size(); ++w) sum += part.weights[w] * histogram[w];
    PartPrior prior;
    prior.part = part.part;
    prior.probability = det::logistic(sum);
    prior.threshold = part.threshold;
    prior.searched = mode != PriorMode::kHard || prior.probability >= part.threshold;
    priors.push_back(prior);
  }
  return priors;
}

}  // namespace weft::detector
