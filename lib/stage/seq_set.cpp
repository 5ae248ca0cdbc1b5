#include "stage/seq_set.hpp"

#include <iterator>
#include <limits>

namespace weft::stage {

void SeqSet::insert(std::int64_t seq) {
  if (contains(seq)) return;
  auto first = seq;
  auto last = seq;
  const auto after = intervals_.upper_bound(seq);
  if (after != intervals_.end() && after->first == seq + 1) {
    last = after->second;
    intervals_.erase(after);
  }
  const auto next = intervals_.upper_bound(seq);
  if (next != intervals_.begin() && std::prev(next)->second == seq - 1) {
    std::prev(next)->second = last;
  } else {
    intervals_.emplace_hint(next, first, last);
  }
  if (intervals_.size() > max_intervals_) {
    const auto low = intervals_.begin();
    const auto second = std::next(low);
    closed_ += second->first - low->second - 1;
    low->second = second->second;
    intervals_.erase(second);
  }
}

bool SeqSet::contains(std::int64_t seq) const {
  const auto after = intervals_.upper_bound(seq);
  return after != intervals_.begin() && std::prev(after)->second >= seq;
}

std::int64_t SeqSet::next_absent(std::int64_t from) const {
  const auto after = intervals_.upper_bound(from);
  if (after == intervals_.begin() || std::prev(after)->second < from) return from;
  const auto last = std::prev(after)->second;
  return last == std::numeric_limits<std::int64_t>::max() ? last : last + 1;
}

std::int64_t SeqSet::missing() const {
  std::int64_t total = closed_;
  for (auto it = intervals_.begin(); it != intervals_.end() && std::next(it) != intervals_.end();
       ++it)
    total += std::next(it)->first - it->second - 1;
  return total;
}

}  // namespace weft::stage
