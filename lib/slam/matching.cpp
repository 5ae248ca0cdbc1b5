#include "slam/matching.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace weft::slam {
namespace {

constexpr int kFar = std::numeric_limits<int>::max();

int cells_of(int size_px, double cell_px) {
  return std::max(1, static_cast<int>(std::ceil(size_px / cell_px)));
}

}  // namespace

FeatureGrid::FeatureGrid(std::span<const Feature> features, int width, int height)
    : features_(features),
      columns_(cells_of(width, kCell_px)),
      rows_(cells_of(height, kCell_px)),
      first_(static_cast<std::size_t>(columns_ * rows_) + 1, 0),
      order_(features.size()) {
  const auto cell_of = [this](const Feature& feature) {
    return static_cast<std::size_t>(cell(feature.v_px, rows_) * columns_ +
                                    cell(feature.u_px, columns_));
  };
  for (const auto& feature : features) ++first_[cell_of(feature) + 1];
  for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  std::vector<int> next(first_.begin(), first_.end() - 1);
  for (std::size_t i = 0; i < features.size(); ++i)
    order_[static_cast<std::size_t>(next[cell_of(features[i])]++)] = static_cast<int>(i);
}

std::vector<Match> match_by_place(std::span<const Sought> sought, const FeatureGrid& grid,
                                  int max_distance, double ratio,
                                  std::span<const std::uint8_t> taken) {
  const auto features = grid.features();
  std::vector<int> owner(features.size(), -1);  // index into matches
  std::vector<Match> matches;
  for (std::size_t i = 0; i < sought.size(); ++i) {
    const Sought& s = sought[i];
    Match best{static_cast<int>(i), -1, kFar};
    int second = kFar, best_level = -1, second_level = -1;
    grid.near(s.u_px, s.v_px, s.radius_px, [&](int index) {
      const Feature& feature = features[static_cast<std::size_t>(index)];
      if (feature.level < s.min_level || feature.level > s.max_level) return;
      if (!taken.empty() && taken[static_cast<std::size_t>(index)] != 0) return;
      const int distance = hamming_distance(s.descriptor, feature.descriptor);
      if (distance < best.distance) {
        second = best.distance;
        second_level = best_level;
        best.distance = distance;
        best.feature = index;
        best_level = feature.level;
      } else if (distance < second) {
        second = distance;
        second_level = feature.level;
      }
    });
    if (best.feature < 0 || best.distance > max_distance) continue;
    if (second != kFar && best_level == second_level && best.distance > ratio * second) continue;
    int& held = owner[static_cast<std::size_t>(best.feature)];
    if (held >= 0) {
      Match& other = matches[static_cast<std::size_t>(held)];
      if (other.distance <= best.distance) continue;
      other.feature = -1;
    }
    held = static_cast<int>(matches.size());
    matches.push_back(best);
  }
  std::erase_if(matches, [](const Match& match) { return match.feature < 0; });
  return matches;
}

std::vector<Match> match_by_looks(std::span<const Feature> a, std::span<const Feature> b,
                                  int max_distance, double ratio) {
  std::vector<int> best_of_b(b.size(), -1);
  std::vector<int> distance_of_b(b.size(), kFar);
  struct Best {
    int feature = -1, distance = kFar, second = kFar;
  };
  std::vector<Best> best_of_a(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    Best& best = best_of_a[i];
    for (std::size_t j = 0; j < b.size(); ++j) {
      const int distance = hamming_distance(a[i].descriptor, b[j].descriptor);
      if (distance < best.distance) {
        best.second = best.distance;
        best.distance = distance;
        best.feature = static_cast<int>(j);
      } else if (distance < best.second) {
        best.second = distance;
      }
      if (distance < distance_of_b[j]) {
        distance_of_b[j] = distance;
        best_of_b[j] = static_cast<int>(i);
      }
    }
  }
  std::vector<Match> matches;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Best& best = best_of_a[i];
    if (best.feature < 0 || best.distance > max_distance) continue;
    if (best.second != kFar && best.distance > ratio * best.second) continue;
    if (best_of_b[static_cast<std::size_t>(best.feature)] != static_cast<int>(i)) continue;
    matches.push_back({static_cast<int>(i), best.feature, best.distance});
  }
  return matches;
}

void keep_common_turn(std::vector<Match>& matches, std::span<const float> turn_deg) {
  constexpr int kBins = 30;
  std::array<int, kBins> counts{};
  std::vector<int> bins(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const float turns = turn_deg[i] / 360.0f;
    const int bin = static_cast<int>(std::lround((turns - std::floor(turns)) * kBins)) % kBins;
    bins[i] = bin;
    ++counts[static_cast<std::size_t>(bin)];
  }
  std::array<int, kBins> order;
  for (int i = 0; i < kBins; ++i) order[static_cast<std::size_t>(i)] = i;
  std::stable_sort(order.begin(), order.end(), [&](int x, int y) {
    return counts[static_cast<std::size_t>(x)] > counts[static_cast<std::size_t>(y)];
  });
  std::array<bool, kBins> kept{};
  const int most = counts[static_cast<std::size_t>(order[0])];
  for (std::size_t k = 0; k < 3; ++k) {
    const auto bin = static_cast<std::size_t>(order[k]);
    kept[bin] = counts[bin] * 10 >= most;
  }
  std::size_t at = 0;
  std::erase_if(matches, [&](const Match&) { return !kept[static_cast<std::size_t>(bins[at++])]; });
}

}  // namespace weft::slam
