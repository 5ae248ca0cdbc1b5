#include "tools/weft/replay.hpp"

#include <algorithm>
#include <optional>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "stage/log.hpp"
#include "tools/weft/log_index.hpp"
#include "tools/weft/log_out.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/progress.hpp"
#include "tools/weft/source_log.hpp"

namespace weft {

ReplayResult replay(const ProcessSet& whole_set, Transport transport, const StageRegistry& registry,
                    const ReplayOptions& options,
                    const std::function<void(const PlayedFrame&, const FrameContent&)>& see) {
  ProcessSet set = whole_set;
  std::erase_if(set.processes, [](const ProcessSpec& process) { return process.source; });
  // Frames go when the pace lets them; of which time they are is known once the log is read.
  const SourceLog* playing = nullptr;
  auto player_options = options.player;
  if (options.pace) {
    player_options.may_send = [&](std::size_t index) {
      const auto now = Pace::Clock::now();
      const auto utime = playing->utime(index);
      const bool may = options.pace->may_send(utime, now);
      if (may) options.pace->sent(utime, now);
      return may;
    };
  }
  Session session(set, transport, registry, options.log_folder, player_options);
  auto& player = session.player();
  player.wait_ready();
  const auto open_inputs = player.open_inputs();
  const auto& channels = options.open_inputs ? open_inputs : set.sources;
  for (const auto& input : open_inputs) {
    if (std::find(channels.begin(), channels.end(), input) == channels.end())
      throw Error("no stage of set " + set.name + " writes " + input +
                  ", which one of them reads; add it to the sources or map it");
  }
  SourceLog source(options.log, channels);
  source.select(options.range);
  playing = &source;
  ReplayResult result;
  result.frames = options.frames > 0 ? options.frames : source.size();
  for (const auto& damage : source.damage())
    result.damage.push_back(options.log + ": " + std::to_string(damage.bytes) +
                            " bytes skipped at byte " + std::to_string(damage.offset) + ": " +
                            damage.what);
  std::optional<LogOut> out;
  if (!options.out.empty()) out.emplace(options.out, std::vector<std::string>{options.log});
  TimingCollector timing;
  Progress progress("frames", static_cast<long>(result.frames));
  std::int64_t last_utime = 0;
  player.play(
      result.frames, [&](std::size_t index) { return source.read(index); },
      [&](PlayedFrame&& frame) {
        last_utime = frame.source.utime;
        if (out) {
          for (const auto& event : frame.source.events)
            out->write(last_utime, event.channel, event.data);
          for (const auto& message : frame.outputs)
            out->write(last_utime, message.channel, message.data);
          for (const auto& each : frame.timings)
            out->write(last_utime, "STAGE_TIMING", encode_message(each));
        }
        for (const auto& each : frame.timings) timing.add(each);
        const auto content = read_content(frame);
        result.answered += frame.unanswered.empty();
        result.failed += content.failed;
        if (!frame.unanswered.empty() && result.unanswered.size() < 10) {
          std::string text = to_string(frame.source.name) + ":";
          for (const auto& channel : frame.unanswered) text += " " + channel;
          result.unanswered.push_back(text);
        }
        see(frame, content);
        progress.update(
            static_cast<long>(frame.index + 1),
            player.resends() > 0 ? std::to_string(player.resends()) + " sent again" : "");
      });
  progress.finish();
  if (out) {
    for (const auto& stage : player.pipeline())
      out->write(last_utime, "STAGE_STATUS", encode_message(player.statuses().at(stage.stage)));
    out->commit();
  }
  result.resends = player.resends();
  result.restarts = player.restarts();
  result.inconsistencies = player.inconsistencies();
  for (const auto& [name, status] : player.statuses()) timing.add(status);
  result.timing = timing.report();
  return result;
}

std::string first_difference(const std::string& log_a, const std::string& log_b,
                             const MessageTypes& types) {
  constexpr std::size_t kFields = 12;
  const LogIndex a(log_a), b(log_b);
  for (const auto* index : {&a, &b}) {
    if (!index->damage.empty())
      throw Error(index->file + ": damaged at byte " +
                  std::to_string(index->damage.front().offset) + ": " + index->damage.front().what);
  }
  for (const auto& key : a.order) {
    const auto other = b.places.find(key);
    if (other == b.places.end()) return to_string(key) + " is in " + log_a + " alone";
    const auto& here = a.places.at(key);
    if (here.hash == other->second.hash && here.size == other->second.size) continue;
    stage::LogReader reader_a(log_a), reader_b(log_b);
    const auto data_a = read_payload(reader_a, here);
    const auto data_b = read_payload(reader_b, other->second);
    const auto at =
        std::mismatch(data_a.begin(), data_a.end(), data_b.begin(), data_b.end()).first -
        data_a.begin();
    return to_string(key) + " differs at byte " + std::to_string(at) + " (" +
           std::to_string(here.size) + " and " + std::to_string(other->second.size) +
           " bytes): " + describe_difference(types, data_a, data_b, kFields);
  }
  for (const auto& key : b.order) {
    if (!a.places.contains(key)) return to_string(key) + " is in " + log_b + " alone";
  }
  return "";
}

std::vector<std::string> payload_hashes(const std::string& log) {
  const LogIndex index(log);
  std::vector<std::string> lines;
  for (const auto& key : index.order) {
    lines.push_back(std::to_string(key.frame.seq) + " " + key.channel + " " +
                    to_hex(index.places.at(key).hash));
  }
  return lines;
}

}  // namespace weft
