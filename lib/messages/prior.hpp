#pragma once

#include <vector>

#include "detector/types.hpp"
#include "weft/image_prior_t.hpp"

/// IMAGE_PRIOR to and from the detector's types.
namespace weft::messages {

struct PriorContent {
  detector::PriorMode mode = detector::PriorMode::kOff;
  std::vector<detector::PartPrior> parts;
};

/// Fills in everything but header and status.
void to_message(const std::vector<detector::PartPrior>& parts, detector::PriorMode mode,
                std::uint64_t model_hash, image_prior_t& message);

/// Throws stage::InvalidInput for unknown modes or parts, parts named twice and probabilities
/// outside 0 to 1.
PriorContent from_message(const image_prior_t& message);

}  // namespace weft::messages
