#include "tools/weft/replay.hpp"

#include <algorithm>
#include <filesystem>
#include <set>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "stage/log.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/progress.hpp"
#include "tools/weft/source_log.hpp"

namespace weft {
namespace {

/// Where each payload stands in a log, by frame and channel, with a count for channels that carry
/// several messages a frame.
struct Place {
  std::int64_t offset = 0;
  std::uint64_t hash = 0;
  std::size_t size = 0;
};
struct Key {
  FrameName frame;
  std::string channel;
  int number = 0;
  auto operator<=>(const Key&) const = default;
};
struct LogIndex {
  std::vector<Key> order;
  std::map<Key, Place> places;
};

LogIndex index_log(const std::string& file) {
  static const std::set<std::string> others = {"STAGE_TIMING", "STAGE_STATUS", "LCM_SELF_TEST"};
  LogIndex index;
  stage::LogReader log(file);
  stage::LogEvent event;
  for (auto offset = log.offset(); log.next(event); offset = log.offset()) {
    if (others.contains(event.channel)) continue;
    const auto header = read_frame_header(event.data);
    if (!header)
      throw Error(file + ": a message on " + event.channel + " at byte " + std::to_string(offset) +
                  " has no frame header");
    Key key{header->frame, event.channel, 0};
    while (index.places.contains(key)) ++key.number;
    Hash64 hash;
    hash.add(event.data.data(), event.data.size());
    index.places[key] = {offset, hash.value(), event.data.size()};
    index.order.push_back(key);
  }
  if (!log.damage().empty())
    throw Error(file + ": damaged at byte " + std::to_string(log.damage().front().offset) + ": " +
                log.damage().front().what);
  return index;
}

std::string describe(const Key& key) {
  return key.channel + " of frame " + to_string(key.frame) +
         (key.number > 0 ? " (message " + std::to_string(key.number + 1) + ")" : "");
}

}  // namespace

ReplayResult replay(const ProcessSet& whole_set, Transport transport, const StageRegistry& registry,
                    const ReplayOptions& options,
                    const std::function<void(const PlayedFrame&, const FrameContent&)>& see) {
  ProcessSet set = whole_set;
  std::erase_if(set.processes, [](const ProcessSpec& process) { return process.source; });
  Session session(set, transport, registry, options.log_folder, options.player);
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
  ReplayResult result;
  result.frames = options.frames > 0 ? options.frames : source.size();
  for (const auto& damage : source.damage())
    result.damage.push_back(options.log + ": " + std::to_string(damage.bytes) +
                            " bytes skipped at byte " + std::to_string(damage.offset) + ": " +
                            damage.what);
  // The log takes its name when it is whole.
  const std::string part = options.out + ".part";
  std::unique_ptr<stage::LogWriter> out;
  if (!options.out.empty()) {
    const auto folder = std::filesystem::path(options.out).parent_path();
    if (!folder.empty()) std::filesystem::create_directories(folder);
    out = std::make_unique<stage::LogWriter>(part);
  }
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
    out->close();
    std::filesystem::rename(part, options.out);
  }
  result.resends = player.resends();
  result.restarts = player.restarts();
  result.inconsistencies = player.inconsistencies();
  for (const auto& [name, status] : player.statuses()) timing.add(status);
  result.timing = timing.report();
  return result;
}

std::string first_difference(const std::string& log_a, const std::string& log_b) {
  const auto a = index_log(log_a), b = index_log(log_b);
  for (const auto& key : a.order) {
    const auto other = b.places.find(key);
    if (other == b.places.end()) return describe(key) + " is in " + log_a + " alone";
    const auto& here = a.places.at(key);
    if (here.hash == other->second.hash && here.size == other->second.size) continue;
    stage::LogReader reader_a(log_a), reader_b(log_b);
    stage::LogEvent event_a, event_b;
    reader_a.seek(here.offset);
    reader_b.seek(other->second.offset);
    reader_a.next(event_a);
    reader_b.next(event_b);
    const auto at = std::mismatch(event_a.data.begin(), event_a.data.end(), event_b.data.begin(),
                                  event_b.data.end())
                        .first -
                    event_a.data.begin();
    return describe(key) + " differs at byte " + std::to_string(at) + " (" +
           std::to_string(here.size) + " and " + std::to_string(other->second.size) + " bytes)";
  }
  for (const auto& key : b.order) {
    if (!a.places.contains(key)) return describe(key) + " is in " + log_b + " alone";
  }
  return "";
}

std::vector<std::string> payload_hashes(const std::string& log) {
  const auto index = index_log(log);
  std::vector<std::string> lines;
  for (const auto& key : index.order) {
    lines.push_back(std::to_string(key.frame.seq) + " " + key.channel + " " +
                    to_hex(index.places.at(key).hash));
  }
  return lines;
}

}  // namespace weft
