#pragma once

#include <vector>

#include "detector/types.hpp"
#include "weft/part_candidates_t.hpp"

/// PART_CANDIDATES to and from the detector's candidates.
namespace weft::messages {

/// Fills in everything but header and status.
void to_message(const std::vector<detector::Candidate>& candidates, std::uint64_t model_hash,
                part_candidates_t& message);

/// Throws stage::InvalidInput for unknown parts, negative cells and probabilities or priors outside
/// 0 to 1. Whether a cell lies on the grid is for who has the grid.
std::vector<detector::Candidate> from_message(const part_candidates_t& message);

}  // namespace weft::messages
