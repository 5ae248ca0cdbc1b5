#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "stage/seq_set.hpp"
#include "tools/weft/bus.hpp"
#include "tools/weft/message_types.hpp"

namespace weft {

/// What a channel carries, as heard here: a message lost on the way is lost for this listener, and
/// maybe for it alone.
struct SpyRow {
  std::string channel;
  std::string type;  // of the newest message; empty: unknown
  std::int64_t messages = 0, bytes = 0;
  double per_second = 0, bytes_per_second = 0;
  double age_s = 0;          // since the newest message
  double longest_gap_s = 0;  // between two messages, or since the newest
  std::int64_t missing = 0;  // sequence numbers between the first and the last heard
  std::int64_t not_ok = 0;   // messages whose status is not OK
  std::int64_t damaged = 0;  // messages that do not decode
};

/// Whether a log and a screen can hold a channel's name: 1 to 63 printable characters of ASCII.
/// Anybody may send others.
bool plain_channel(const std::string& channel);

class SpyTable {
 public:
  explicit SpyTable(const MessageTypes& types) : types_(types) {}
  /// Channels whose names are not plain are counted together, as "(unreadable)", and
  /// those beyond a thousand as "(more)".
  void add(const BusMessage& message, std::int64_t now_us);
  /// Rates are those of the last window_s, or of all the time since the first message heard on any
  /// channel when that is less.
  std::vector<SpyRow> rows(std::int64_t now_us, double window_s) const;
  /// The newest message of a channel as lines of text, arrays of numbers in one line each.
  std::vector<std::string> fields(const std::string& channel) const;

 private:
  struct Channel {
    SpyRow total;
    std::int64_t newest_us = 0;
    std::int64_t longest_gap_us = 0;
    std::deque<std::pair<std::int64_t, std::size_t>> recent;  // time, bytes
    std::map<std::pair<std::string, std::int64_t>, stage::SeqSet> seqs;
    std::vector<std::uint8_t> newest;
  };
  const MessageTypes& types_;
  std::map<std::string, Channel> channels_;
  std::int64_t first_us_ = 0;
};

std::string to_text(const std::vector<SpyRow>& rows);

/// Lines "path: value"; arrays of numbers as "path[count]: first ones ...".
std::vector<std::string> field_lines(const std::vector<MessageField>& fields);

}  // namespace weft
