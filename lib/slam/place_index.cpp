#include "slam/place_index.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/error.hpp"

namespace weft::slam {

PlaceIndex::PlaceIndex(int words) {
  if (words < 1)
    throw Error("place index: " + std::to_string(words) + " words; expected 1 or more");
  inverted_.resize(static_cast<std::size_t>(words));
}

void PlaceIndex::add(std::int64_t place, const BagOfWords& bag) {
  if (bags_.contains(place)) {
    throw Error("place index: place " + std::to_string(place) + " is known already");
  }
  for (const auto& [word, weight] : bag) {
    if (word < 0 || static_cast<std::size_t>(word) >= inverted_.size()) {
      throw Error("place index: word " + std::to_string(word) + " of " +
                  std::to_string(inverted_.size()));
    }
  }
  bags_.emplace(place, bag);
  for (const auto& [word, weight] : bag) {
    inverted_[static_cast<std::size_t>(word)].push_back({place, weight});
  }
}

void PlaceIndex::remove(std::int64_t place) {
  for (const auto& [word, weight] : bag(place)) {
    std::erase_if(inverted_[static_cast<std::size_t>(word)],
                  [&](const Entry& entry) { return entry.place == place; });
  }
  bags_.erase(place);
}

const BagOfWords& PlaceIndex::bag(std::int64_t place) const {
  const auto found = bags_.find(place);
  if (found == bags_.end()) {
    throw Error("place index: place " + std::to_string(place) + " is not known");
  }
  return found->second;
}

std::vector<PlaceCandidate> PlaceIndex::query(const BagOfWords& bag,
                                              double min_shared_share) const {
  struct Sum {
    int shared = 0;
    double score = 0.0;
  };
  std::map<std::int64_t, Sum> sums;
  for (const auto& [word, weight] : bag) {
    if (word < 0 || static_cast<std::size_t>(word) >= inverted_.size()) {
      throw Error("place index: word " + std::to_string(word) + " of " +
                  std::to_string(inverted_.size()));
    }
    for (const Entry& entry : inverted_[static_cast<std::size_t>(word)]) {
      Sum& sum = sums[entry.place];
      ++sum.shared;
      // 1 - |a - b| / 2 over words of sum 1 is the sum of the smaller weights.
      sum.score += std::min(weight, entry.weight);
    }
  }
  int most = 0;
  for (const auto& [place, sum] : sums) most = std::max(most, sum.shared);
  std::vector<PlaceCandidate> out;
  for (const auto& [place, sum] : sums) {
    if (sum.shared >= min_shared_share * most) out.push_back({place, sum.shared, sum.score});
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  return out;
}

}  // namespace weft::slam
