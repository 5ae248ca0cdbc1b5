#pragma once

#include <cstddef>
#include <cstdint>
#include <map>

namespace weft::stage {

/// A set of sequence numbers (>= 0) kept as intervals. Bounded: beyond max_intervals the lowest gap
/// is closed, as if its numbers were in the set; they stay counted as missing.
class SeqSet {
 public:
  explicit SeqSet(std::size_t max_intervals = 256) : max_intervals_(max_intervals) {}
  void insert(std::int64_t seq);
  bool contains(std::int64_t seq) const;
  /// The lowest number >= from that is not in the set.
  std::int64_t next_absent(std::int64_t from) const;
  /// How many numbers between the lowest and the highest never came.
  std::int64_t missing() const;
  std::size_t intervals() const { return intervals_.size(); }

 private:
  std::size_t max_intervals_;
  std::map<std::int64_t, std::int64_t> intervals_;  // first to last, both in the set
  std::int64_t closed_ = 0;
};

}  // namespace weft::stage
