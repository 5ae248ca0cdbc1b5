#include "tools/weft/log_index.hpp"

#include <set>

#include "base/error.hpp"
#include "base/hash.hpp"

namespace weft {

std::string to_string(const LogKey& key) {
  const auto number =
      key.number > 0 || key.frame.camera.empty() ? std::to_string(key.number + 1) : "";
  if (key.frame.camera.empty()) return "message " + number + " on " + key.channel;
  return key.channel + " of frame " + to_string(key.frame) +
         (number.empty() ? "" : " (message " + number + ")");
}

LogIndex::LogIndex(const std::string& log) : file(log) {
  static const std::set<std::string> others = {"STAGE_TIMING", "STAGE_STATUS", "LCM_SELF_TEST"};
  stage::LogReader reader(log);
  stage::LogEvent event;
  std::map<LogKey, int> counts;
  while (reader.next(event)) {
    if (others.contains(event.channel)) continue;
    const auto header = read_frame_header(event.data);
    LogKey key{header ? header->frame : FrameName{}, event.channel, 0};
    key.number = counts[key]++;
    Hash64 hash;
    hash.add(event.data.data(), event.data.size());
    const auto begin = reader.offset() - static_cast<std::int64_t>(event.data.size()) -
                       static_cast<std::int64_t>(event.channel.size()) - 28;
    places[key] = {begin, hash.value(), event.data.size()};
    order.push_back(std::move(key));
  }
  damage = reader.damage();
}

std::vector<std::uint8_t> read_payload(stage::LogReader& log, const LogIndex::Place& place) {
  log.seek(place.offset);
  stage::LogEvent event;
  if (!log.next(event)) throw Error("the log changed while it was read");
  return std::move(event.data);
}

}  // namespace weft
