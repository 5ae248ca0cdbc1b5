#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "slam/vocabulary.hpp"

namespace weft::slam {

struct PlaceCandidate {
  std::int64_t place;
  int shared_words;
  double score;  // similarity() of the bags
};

/// Which of the places seen before look like this one: an inverted file from words to places.
class PlaceIndex {
 public:
  explicit PlaceIndex(int words);

  /// Throws Error when the place is known already or a word is out of range.
  void add(std::int64_t place, const BagOfWords& bag);
  /// Throws Error when the place is not known.
  void remove(std::int64_t place);
  int size() const { return static_cast<int>(bags_.size()); }
  const BagOfWords& bag(std::int64_t place) const;

  /// All places that share a word, best score first (of equals the smaller number first).
  /// min_shared_share: only those with at least this share of the most words that any place shares
  /// (ORB-SLAM2: 0.8).
  std::vector<PlaceCandidate> query(const BagOfWords& bag, double min_shared_share = 0.0) const;

 private:
  std::map<std::int64_t, BagOfWords> bags_;
  struct Entry {
    std::int64_t place;
    double weight;
  };
  std::vector<std::vector<Entry>> inverted_;
};

}  // namespace weft::slam
