#include "detector/part_scorer.hpp"

#include <algorithm>

#include "base/parallel.hpp"

namespace weft::detector {

PartScores score_parts(const ScoreModel& model, std::span<const bovw::WordGrid* const> grids,
                       std::span<const PartPrior> priors, PriorMode mode,
                       const ScoreOptions& options, int threads) {
  options.validate();
  const WindowScorer scorer(model, grids);
  struct Search {
    int part;
    double prior;
    std::vector<Candidate> candidates;
    ProbabilityMap map;
  };
  std::vector<Search> searches;
  for (int part = 0; part < static_cast<int>(model.parts.size()); ++part) {
    const auto& name = model.parts[static_cast<std::size_t>(part)].part;
    const auto prior = std::find_if(priors.begin(), priors.end(),
                                    [&](const PartPrior& each) { return each.part == name; });
    double factor = 1.0;
    if (prior != priors.end()) {
      if (mode == PriorMode::kHard && !prior->searched) continue;
      if (mode == PriorMode::kSoft) factor = prior->probability;
    }
    searches.push_back({part, factor, {}, {}});
  }
  parallel_for(static_cast<int>(searches.size()), threads, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      Search& search = searches[static_cast<std::size_t>(i)];
      const auto& name = model.parts[static_cast<std::size_t>(search.part)].part;
      const auto map = probability_map(scorer, search.part, options.map);
      search.candidates = find_peaks(map, name, scorer.grid().step_px, options.peaks);
      for (auto& candidate : search.candidates) candidate.prior = search.prior;
      search.map = to_probability_map(map, name);
    }
  });
  PartScores scores;
  for (auto& search : searches) {
    std::move(search.candidates.begin(), search.candidates.end(),
              std::back_inserter(scores.candidates));
    scores.maps.push_back(std::move(search.map));
  }
  return scores;
}

}  // namespace weft::detector
