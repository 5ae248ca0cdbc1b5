#pragma once

#include <span>
#include <vector>

#include "detector/peaks.hpp"
#include "detector/probability_map.hpp"
#include "detector/types.hpp"
#include "detector/window_scorer.hpp"

namespace weft::detector {

struct ScoreOptions {
  MapOptions map;
  PeakOptions peaks;

  void visit(OptionVisitor& v) {
    v.group("map", map);
    v.group("peaks", peaks);
  }
  void validate() const {
    map.validate();
    peaks.validate();
  }
};

struct PartScores {
  std::vector<Candidate> candidates;  // best first within each part, parts as in the model
  std::vector<ProbabilityMap> maps;   // of the searched parts
};

/// The first layer over all parts of the model. priors: empty, or one entry for each part that is
/// to be searched or not; parts without an entry are searched with prior 1. Mode soft hands the
/// prior's probability on to the candidates; off and hard hand on 1. threads < 1: one for each
/// core.
PartScores score_parts(const ScoreModel& model, std::span<const bovw::WordGrid* const> grids,
                       std::span<const PartPrior> priors, PriorMode mode,
                       const ScoreOptions& options, int threads);

}  // namespace weft::detector
