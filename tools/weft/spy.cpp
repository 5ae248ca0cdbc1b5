#include "tools/weft/spy.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "stage/telemetry.hpp"
#include "tools/weft/frame_name.hpp"

namespace weft {
namespace {

/// More than this is kept for no rate.
constexpr std::int64_t kMemory_us = 60'000'000;
constexpr std::size_t kMostRecent = 100'000;
constexpr std::size_t kMostSessions = 64;
constexpr std::size_t kMostChannels = 1000;

/// "cells" of "cells[3][1]"; empty when the path is no element of an array of plain values.
std::string array_of(const std::string& path) {
  if (!path.ends_with("]")) return "";
  const auto dot = path.rfind('.');
  const auto open = path.find('[', dot == std::string::npos ? 0 : dot);
  return path.substr(0, open);
}

}  // namespace

bool plain_channel(const std::string& channel) {
  constexpr std::size_t kLongest = 63;
  return !channel.empty() && channel.size() <= kLongest &&
         std::all_of(channel.begin(), channel.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

void SpyTable::add(const BusMessage& message, std::int64_t now_us) {
  if (first_us_ == 0) first_us_ = now_us;
  std::string name = plain_channel(message.channel) ? message.channel : "(unreadable)";
  if (channels_.size() >= kMostChannels && !channels_.contains(name)) name = "(more)";
  auto& channel = channels_[name];
  if (channel.total.messages > 0)
    channel.longest_gap_us = std::max(channel.longest_gap_us, now_us - channel.newest_us);
  channel.newest_us = now_us;
  channel.newest = message.data;
  ++channel.total.messages;
  channel.total.bytes += static_cast<std::int64_t>(message.data.size());
  channel.recent.emplace_back(now_us, message.data.size());
  while (channel.recent.size() > kMostRecent || channel.recent.front().first < now_us - kMemory_us)
    channel.recent.pop_front();
  if (types_.check(message.data) == MessageTypes::Verdict::kDamaged) {
    ++channel.total.damaged;
    return;
  }
  channel.total.type = types_.type_of(message.data);
  if (message.channel == stage::kTimingChannel || message.channel == stage::kStatusChannel) return;
  const auto header = read_frame_header(message.data);
  if (!header || header->frame.seq < 0) return;
  channel.total.not_ok += header->status_code != 0;
  if (channel.seqs.size() > kMostSessions) channel.seqs.erase(channel.seqs.begin());
  channel.seqs[{header->frame.camera, header->frame.session}].insert(header->frame.seq);
}

std::vector<SpyRow> SpyTable::rows(std::int64_t now_us, double window_s) const {
  std::vector<SpyRow> rows;
  const double seconds =
      std::max(1e-3, std::min(window_s, static_cast<double>(now_us - first_us_) * 1e-6));
  const auto from_us = now_us - static_cast<std::int64_t>(seconds * 1e6);
  for (const auto& [name, channel] : channels_) {
    auto row = channel.total;
    row.channel = name;
    std::int64_t count = 0, bytes = 0;
    for (auto at = channel.recent.rbegin(); at != channel.recent.rend() && at->first >= from_us;
         ++at) {
      ++count;
      bytes += static_cast<std::int64_t>(at->second);
    }
    row.per_second = static_cast<double>(count) / seconds;
    row.bytes_per_second = static_cast<double>(bytes) / seconds;
    const auto age_us = now_us - channel.newest_us;
    row.age_s = static_cast<double>(age_us) * 1e-6;
    row.longest_gap_s = static_cast<double>(std::max(age_us, channel.longest_gap_us)) * 1e-6;
    for (const auto& [session, seqs] : channel.seqs) row.missing += seqs.missing();
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<std::string> SpyTable::fields(const std::string& channel) const {
  const auto at = channels_.find(channel);
  if (at == channels_.end()) return {"no message was heard on " + channel};
  const auto decoded = types_.decode(at->second.newest);
  if (!decoded) {
    const auto type = types_.type_of(at->second.newest);
    return {fmt::format("{} bytes of {}", at->second.newest.size(),
                        type.empty() ? "an unknown type; --types FOLDER names your .lcm files"
                                     : type + ", damaged")};
  }
  auto lines = field_lines(decoded->fields);
  lines.insert(lines.begin(), decoded->type);
  return lines;
}

std::string to_text(const std::vector<SpyRow>& rows) {
  auto text = fmt::format("{:<24} {:<18} {:>8} {:>9} {:>9} {:>8} {:>9} {:>8} {:>7} {:>8}\n",
                          "channel", "type", "messages", "Hz", "kB/s", "age s", "max gap s",
                          "missing", "not OK", "damaged");
  for (const auto& row : rows) {
    text +=
        fmt::format("{:<24} {:<18} {:>8} {:>9.1f} {:>9.1f} {:>8.2f} {:>9.2f} {:>8} {:>7} {:>8}\n",
                    row.channel, row.type.empty() ? "?" : row.type, row.messages, row.per_second,
                    row.bytes_per_second / 1000, row.age_s, row.longest_gap_s, row.missing,
                    row.not_ok, row.damaged);
  }
  return text;
}

std::vector<std::string> field_lines(const std::vector<MessageField>& fields) {
  constexpr std::size_t kShown = 12;
  std::vector<std::string> lines;
  for (std::size_t i = 0; i < fields.size();) {
    const auto array = array_of(fields[i].path);
    std::size_t end = i + 1;
    while (!array.empty() && end < fields.size() && array_of(fields[end].path) == array) ++end;
    if (array.empty()) {
      lines.push_back(fields[i].path + ": " + fields[i].text);
    } else {
      auto line = fmt::format("{}[{}]:", array, end - i);
      for (std::size_t k = i; k < std::min(end, i + kShown); ++k) line += " " + fields[k].text;
      lines.push_back(line + (end - i > kShown ? " ..." : ""));
    }
    i = end;
  }
  return lines;
}

}  // namespace weft
