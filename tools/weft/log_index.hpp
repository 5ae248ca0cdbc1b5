#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "stage/log.hpp"
#include "tools/weft/frame_name.hpp"

namespace weft {

/// A message of a log by what it is about: the number-th on its channel for its frame, or of all on
/// its channel when it has no frame header.
struct LogKey {
  FrameName frame;  // no camera: none
  std::string channel;
  int number = 0;
  auto operator<=>(const LogKey&) const = default;  // NOLINT(modernize-use-nullptr)
};
std::string to_string(const LogKey& key);

/// Where each message stands in a log, by frame and channel. STAGE_TIMING, STAGE_STATUS and LCM's
/// own are left out.
struct LogIndex {
  struct Place {
    std::int64_t offset = 0;
    std::uint64_t hash = 0;
    std::size_t size = 0;
  };
  explicit LogIndex(const std::string& log);
  std::string file;
  std::vector<LogKey> order;  // as in the log
  std::map<LogKey, Place> places;
  std::vector<stage::LogReader::Damage> damage;
};

/// The payload of an indexed message.
std::vector<std::uint8_t> read_payload(stage::LogReader& log, const LogIndex::Place& place);

}  // namespace weft
