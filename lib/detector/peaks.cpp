#include "detector/peaks.hpp"

#include <algorithm>

namespace weft::detector {
namespace {

bool is_peak(const FixedMap& map, int column, int row) {
  const auto value = map.values[static_cast<std::size_t>(row * map.columns + column)];
  for (int y = std::max(0, row - 1); y <= std::min(map.rows - 1, row + 1); ++y) {
    for (int x = std::max(0, column - 1); x <= std::min(map.columns - 1, column + 1); ++x) {
      const auto other = map.values[static_cast<std::size_t>(y * map.columns + x)];
      const bool earlier = y < row || (y == row && x < column);
      if (other > value || (other == value && earlier)) return false;
    }
  }
  return true;
}

}  // namespace

std::vector<Candidate> find_peaks(const FixedMap& map, const std::string& part, double step_px,
                                  const PeakOptions& options) {
  options.validate();
  const double scale = 1 << FixedMap::kProbabilityBits;
  std::vector<Candidate> peaks;
  for (int row = 0; row < map.rows; ++row) {
    for (int column = 0; column < map.columns; ++column) {
      const double probability =
          map.values[static_cast<std::size_t>(row * map.columns + column)] / scale;
      if (probability <= 0.0 || probability < options.min_probability) continue;
      if (is_peak(map, column, row)) peaks.push_back({part, column, row, probability, 1.0});
    }
  }
  std::stable_sort(peaks.begin(), peaks.end(), [](const Candidate& a, const Candidate& b) {
    return a.probability > b.probability;
  });
  std::vector<Candidate> kept;
  for (const auto& peak : peaks) {
    const bool hidden = std::any_of(kept.begin(), kept.end(), [&](const Candidate& better) {
      const double dx = (peak.column - better.column) * step_px;
      const double dy = (peak.row - better.row) * step_px;
      return dx * dx + dy * dy < options.min_distance_px * options.min_distance_px;
    });
    if (hidden) continue;
    kept.push_back(peak);
    if (static_cast<int>(kept.size()) == options.max_peaks) break;
  }
  return kept;
}

}  // namespace weft::detector
