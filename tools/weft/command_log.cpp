#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "base/error.hpp"
#include "stage/log.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/page.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/text_file.hpp"
#include "tools/weft/timing_report.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {
namespace {

void print_damage(const std::string& file, const stage::LogReader& log) {
  for (const auto& damage : log.damage())
    fmt::print(stderr, "{}: {} bytes skipped at byte {}: {}\n", file, damage.bytes, damage.offset,
               damage.what);
}

}  // namespace

int timing_command(const std::string& file, const std::string& json, const std::string& html) {
  stage::LogReader log(file);
  stage::LogEvent event;
  TimingCollector timing;
  std::size_t undecodable = 0;
  while (log.next(event)) {
    if (event.channel != stage::kTimingChannel) continue;
    const auto message = decode_message<weft::stage_timing_t>(event.data);
    if (message) {
      timing.add(*message);
    } else {
      ++undecodable;
    }
  }
  print_damage(file, log);
  if (undecodable > 0)
    fmt::print(stderr, "{}: {} messages on STAGE_TIMING do not decode\n", file, undecodable);
  const auto report = timing.report();
  if (report.frames.empty())
    throw Error(file + ": holds no STAGE_TIMING; record that channel, or replay the log");
  fmt::print("{}", to_text(report));
  if (!json.empty()) write_text_file(json, to_json(report) + "\n");
  if (!html.empty()) {
    write_text_file(html,
                    make_page("timing.html", {{"title", file}, {"timing", page_timing(report)}}));
    fmt::print("timeline: {}\n", html);
  }
  return log.damage().empty() && undecodable == 0 ? 0 : 1;
}

int log_info_command(const std::string& file, const std::string& json_file) {
  struct Channel {
    std::size_t messages = 0, bytes = 0, largest = 0;
    std::set<FrameName> frames;
    std::map<int, std::size_t> status;
  };
  std::map<std::string, Channel> channels;
  std::map<std::pair<std::string, std::int64_t>, std::pair<std::int64_t, std::int64_t>> sessions;
  std::int64_t first = std::numeric_limits<std::int64_t>::max();
  std::int64_t last = std::numeric_limits<std::int64_t>::min();
  stage::LogReader log(file);
  stage::LogEvent event;
  std::size_t count = 0;
  while (log.next(event)) {
    ++count;
    first = std::min(first, event.timestamp_us);
    last = std::max(last, event.timestamp_us);
    auto& channel = channels[event.channel];
    ++channel.messages;
    channel.bytes += event.data.size();
    channel.largest = std::max(channel.largest, event.data.size());
    if (event.channel == stage::kTimingChannel || event.channel == stage::kStatusChannel) continue;
    const auto header = read_frame_header(event.data);
    if (!header) continue;
    channel.frames.insert(header->frame);
    ++channel.status[header->status_code];
    const auto& [camera, session, seq] = header->frame;
    auto [at, is_new] = sessions.try_emplace({camera, session}, seq, seq);
    at->second.first = std::min(at->second.first, seq);
    at->second.second = std::max(at->second.second, seq);
  }
  const double seconds = count > 0 ? static_cast<double>(last - first) * 1e-6 : 0;
  nlohmann::ordered_json json{{"events", count}, {"bytes", log.size()}, {"seconds", seconds}};
  fmt::print("{}: {} events, {:.1f} MB, {:.1f} s\n\n", file, count,
             static_cast<double>(log.size()) / 1e6, seconds);
  fmt::print("{:<28} {:>9} {:>8} {:>10} {:>10}  {}\n", "channel", "messages", "frames",
             "mean bytes", "largest", "not OK");
  json["channels"] = nlohmann::ordered_json::object();
  for (const auto& [name, channel] : channels) {
    std::size_t not_ok = 0;
    for (const auto& [code, n] : channel.status) not_ok += code == 0 ? 0 : n;
    fmt::print("{:<28} {:>9} {:>8} {:>10} {:>10}  {}\n", name, channel.messages,
               channel.frames.size(), channel.bytes / channel.messages, channel.largest, not_ok);
    json["channels"][name] = {{"messages", channel.messages},
                              {"frames", channel.frames.size()},
                              {"bytes", channel.bytes},
                              {"largest", channel.largest},
                              {"not_ok", not_ok}};
  }
  fmt::print("\n");
  json["sessions"] = nlohmann::ordered_json::array();
  for (const auto& [key, range] : sessions) {
    fmt::print("camera {}, session {}: frames {} to {}\n", key.first, key.second, range.first,
               range.second);
    json["sessions"].push_back({{"camera", key.first},
                                {"session", key.second},
                                {"first", range.first},
                                {"last", range.second}});
  }
  json["damage"] = nlohmann::ordered_json::array();
  for (const auto& damage : log.damage())
    json["damage"].push_back(
        {{"byte", damage.offset}, {"skipped", damage.bytes}, {"what", damage.what}});
  print_damage(file, log);
  if (!json_file.empty()) write_text_file(json_file, json.dump(2) + "\n");
  return log.damage().empty() ? 0 : 1;
}

int log_hash_command(const std::string& file) {
  for (const auto& line : payload_hashes(file)) fmt::print("{}\n", line);
  return 0;
}

}  // namespace weft
