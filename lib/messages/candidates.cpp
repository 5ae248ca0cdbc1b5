#include "messages/candidates.hpp"

#include <algorithm>

#include "stage/stage.hpp"

namespace weft::messages {

void to_message(const std::vector<detector::Candidate>& candidates, std::uint64_t model_hash,
                part_candidates_t& message) {
  message.model_hash = static_cast<std::int64_t>(model_hash);
  message.candidates.clear();
  for (const auto& candidate : candidates) {
    part_candidate_t m;
    m.part = candidate.part;
    m.column = candidate.column;
    m.row = candidate.row;
    m.probability = candidate.probability;
    m.prior = candidate.prior;
    message.candidates.push_back(std::move(m));
  }
  message.candidate_count = static_cast<std::int32_t>(message.candidates.size());
}

std::vector<detector::Candidate> from_message(const part_candidates_t& message) {
  std::vector<detector::Candidate> candidates;
  for (const auto& m : message.candidates) {
    if (std::find(detector::kParts.begin(), detector::kParts.end(), m.part) ==
        detector::kParts.end()) {
      throw stage::InvalidInput("PART_CANDIDATES: unknown part '" + m.part.substr(0, 64) + "'");
    }
    if (m.column < 0 || m.row < 0 || !(m.probability >= 0.0 && m.probability <= 1.0) ||
        !(m.prior >= 0.0 && m.prior <= 1.0)) {
      throw stage::InvalidInput("PART_CANDIDATES: " + m.part +
                                ": cell, probability or prior is impossible");
    }
    candidates.push_back({m.part, m.column, m.row, m.probability, m.prior});
  }
  return candidates;
}

}  // namespace weft::messages
