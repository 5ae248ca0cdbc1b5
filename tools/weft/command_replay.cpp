#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/error.hpp"
#include "base/project.hpp"
#include "base/text_file.hpp"
#include "dataset/scene.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/demo_page.hpp"
#include "tools/weft/keys.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/spy.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

void print_problems(const ReplayResult& result) {
  for (const auto& each : result.damage) fmt::print(stderr, "damaged log: {}\n", each);
  for (const auto& each : result.unanswered) fmt::print(stderr, "unanswered: frame {}\n", each);
  for (const auto& each : result.inconsistencies)
    fmt::print(stderr, "not the same answer to the same input: {}\n", each);
}

nlohmann::ordered_json to_json(const ReplayResult& result) {
  nlohmann::ordered_json json;
  json["frames"] = result.frames;
  json["answered"] = result.answered;
  json["failed"] = result.failed;
  json["resends"] = result.resends;
  json["restarts"] = result.restarts;
  const auto timing = nlohmann::ordered_json::parse(to_json(result.timing));
  json["frames_per_second"] = timing["frames_per_second"];
  json["end_to_end"] = timing.value("end_to_end", nlohmann::ordered_json::object());
  json["stages"] = timing["stages"];
  return json;
}

/// A frame and what was said about it; show: channels to decode.
void print_frame(const PlayedFrame& frame, const FrameContent& content,
                 const std::vector<std::string>& show, const MessageTypes& types) {
  fmt::print("frame {}", to_string(frame.source.name));
  for (const auto& timing : frame.timings)
    fmt::print("  {} {:.1f} ms", timing.stage,
               static_cast<double>(timing.finished_utime - timing.started_utime) / 1000);
  fmt::print("\n");
  for (const auto& problem : content.problems) fmt::print("  {}\n", problem);
  const auto print_message = [&](const std::string& channel,
                                 const std::vector<std::uint8_t>& data) {
    if (std::find(show.begin(), show.end(), channel) == show.end()) return;
    const auto decoded = types.decode(data);
    if (!decoded) {
      fmt::print("  {}: {} bytes of an unknown type\n", channel, data.size());
      return;
    }
    fmt::print("  {}: {}\n", channel, decoded->type);
    for (const auto& line : field_lines(decoded->fields)) fmt::print("    {}\n", line);
  };
  for (const auto& event : frame.source.events) print_message(event.channel, event.data);
  for (const auto& message : frame.outputs) print_message(message.channel, message.data);
  std::fflush(stdout);
}

Transport pick_transport(bool in_process, bool attach) {
  if (in_process) return Transport::kInProcess;
  if (attach) return Transport::kAttach;
  std::string why;
  const auto transport = choose_transport(why);
  fmt::print("{}\n", why);
  std::fflush(stdout);
  return transport;
}

/// Part polygons of the scenes a log was captured from.
class Truth {
 public:
  /// folder: empty for none.
  explicit Truth(const std::string& folder) {
    if (!folder.empty()) dataset_ = dataset::open_dataset(folder);
  }
  std::vector<dataset::PartPolygon> of(const FrameContent& content) const {
    if (!dataset_ || !content.rgbd) return {};
    const auto& names = dataset_->names();
    const auto at = std::find(names.begin(), names.end(), content.rgbd->source);
    if (at == names.end()) return {};
    return dataset_->read(static_cast<std::size_t>(at - names.begin())).polygons;
  }

 private:
  std::unique_ptr<dataset::Dataset> dataset_;
};

}  // namespace

int replay_command(const ReplayCommand& command, const StageRegistry& registry) {
  catch_stop_signals();
  auto set = ProcessSet::from_file(command.set);
  for (const auto& swap : command.swaps) {
    const auto equals = swap.find('=');
    if (equals == std::string::npos || equals + 1 == swap.size())
      throw Error("--swap " + swap + ": expected STAGE=PROGRAM");
    const auto program = swap.substr(equals + 1);
    set.find(swap.substr(0, equals)).exec =
        program.find('/') == std::string::npos ? program : fs::absolute(program).string();
  }
  ReplayOptions options;
  if (!command.from.empty()) {
    set.find(command.from);
    while (set.processes.front().name != command.from) set.processes.erase(set.processes.begin());
    options.open_inputs = true;
  }
  if (!fs::is_regular_file(command.log)) throw Error(command.log + ": there is no such log");
  const auto transport = pick_transport(command.in_process, command.attach);
  options.log = command.log;
  options.out = command.out;
  options.log_folder = command.out + ".logs";
  options.player.window = command.window;
  options.player.answer_timeout =
      std::chrono::milliseconds(static_cast<int>(command.timeout_s * 1000));
  options.range = command.range;
  MessageTypes types = MessageTypes::built_in();
  if (!command.types.empty()) types.add_folder(command.types);
  std::optional<Keys> keys;
  std::optional<Pace> pace;
  if (command.step || command.speed > 0) {
    keys.emplace();
    pace.emplace(command.speed, command.step, [&] { return keys->next(); });
    options.pace = &*pace;
    if (command.step) options.player.window = 1;
    fmt::print("space: pause, go on   s, Enter: one frame   + -: speed   q: end\n");
    std::fflush(stdout);
  }
  const auto play = [&] {
    return replay(set, transport, registry, options,
                  [&](const PlayedFrame& frame, const FrameContent& content) {
                    if (command.step || !command.show.empty())
                      print_frame(frame, content, command.show, types);
                  });
  };
  const auto result = play();
  print_problems(result);
  fmt::print("{} of {} frames answered on every channel, {} failed, {} sent again; {}\n",
             result.answered, result.frames, result.failed, result.resends, command.out);
  fmt::print("\n{}", to_text(result.timing));
  if (!command.json.empty()) write_text_file(command.json, to_json(result).dump(2) + "\n");
  bool good = result.good();
  if (command.verify) {
    std::string reference = command.reference;
    if (reference.empty()) {
      fmt::print("\nreplaying again to compare\n");
      std::fflush(stdout);
      options.out = reference = command.out + ".second";
      options.pace = nullptr;
      good = play().good() && good;
    }
    const auto difference = first_difference(command.out, reference, types);
    if (difference.empty()) {
      fmt::print("verified: the same payloads on every channel\n");
      if (command.reference.empty()) fs::remove(reference);
    } else {
      fmt::print(stderr, "not the same: {}\n", difference);
      good = false;
    }
  }
  return good ? 0 : 1;
}

int demo_command(const DemoCommand& command, const StageRegistry& registry) {
  catch_stop_signals();
  const auto set = ProcessSet::from_file(
      command.set.empty() ? find_in_project("config/sets/parts-sift.yaml") : command.set);
  ReplayOptions options;
  options.log = command.log.empty() ? find_in_project("logs/sample.lcm") : command.log;
  options.out = command.out + "/demo.lcm";
  options.log_folder = command.out + "/logs";
  options.frames = static_cast<std::size_t>(command.frames);
  options.player.window = command.window;
  if (!fs::is_regular_file(options.log)) throw Error(options.log + ": there is no such log");
  const auto transport = pick_transport(command.in_process, false);
  const Truth truth(command.truth);
  DemoPage page(command.out, command.threshold);
  std::size_t detections = 0;
  std::map<std::string, std::size_t> by_part;
  std::string lines;
  std::vector<std::pair<PlayedFrame, FrameContent>> shown;  // drawn when the clock has stopped
  const auto result = replay(
      set, transport, registry, options,
      [&](const PlayedFrame& frame, const FrameContent& content) {
        std::vector<std::pair<std::string, int>> parts;  // best first, and how often
        std::map<std::string, double> best;
        std::string guess;
        if (content.detections) {
          for (const auto& each : content.detections->detections) {
            if (guess.empty()) guess = fmt::format("{} {:.2f}", each.part, each.probability);
            if (each.probability < command.threshold) continue;
            ++detections;
            ++by_part[each.part];
            const auto [at, is_new] = best.emplace(each.part, each.probability);
            at->second = std::max(at->second, each.probability);
            if (is_new) parts.emplace_back(each.part, 0);
            for (auto& part : parts) part.second += part.first == each.part;
          }
        }
        std::string found;
        for (const auto& [part, count] : parts) {
          found += fmt::format("{}{} {:.2f}", found.empty() ? "" : ", ", part, best[part]);
          if (count > 1) found += fmt::format(" (and {} more)", count - 1);
        }
        if (frame.source.pass > 0) return;  // the same pictures again
        shown.emplace_back(frame, content);
        if (content.pose) {
          const auto& at = content.pose->T_world_camera.translation;
          found += fmt::format(
              "{}{}", found.empty() ? "" : "; ",
              content.pose->state == camera_pose_t::TRACKED
                  ? fmt::format("camera at {:.3f} {:.3f} {:.3f} m, {} points, {} planes", at[0],
                                at[1], at[2], content.pose->points, content.pose->planes)
                  : "camera not tracked: " + content.pose->reason);
        }
        if (found.empty() && !content.problems.empty()) found = content.problems.front();
        if (found.empty())
          found = guess.empty() ? "nothing" : fmt::format("nothing; at best {}", guess);
        lines += fmt::format("  {:>4}  {:<28} {}\n", frame.source.name.seq,
                             content.rgbd ? content.rgbd->source : "", found);
      });
  fmt::print("\nWhat was found, with probabilities of {} or more:\n{}\n", command.threshold, lines);
  for (const auto& [part, count] : by_part) fmt::print("  {:<22} {}\n", part, count);
  fmt::print("\n{}\n", to_text(result.timing));
  const std::string frames = std::to_string(result.frames);
  fmt::print("{} frames, {} answered on every channel, {} failed, {} detections, {} sent again\n",
             result.frames, result.answered, result.failed, detections, result.resends);
  print_problems(result);
  for (const auto& [frame, content] : shown) page.add(frame, content, truth.of(content));
  const bool all = result.answered == result.frames;
  page.write(fmt::format("{} on {}", set.name, fs::path(options.log).filename().string()),
             {{"frames", frames, ""},
              {"answered by every stage", std::to_string(result.answered), all ? "good" : "bad"},
              {"failed", std::to_string(result.failed), result.failed == 0 ? "good" : "bad"},
              {"detections", std::to_string(detections), ""},
              {"frames per second", fmt::format("{:.1f}", result.timing.frames_per_second), ""},
              {"ms from frame to answer, median",
               fmt::format("{:.0f}", result.timing.end_to_end.p50), ""}},
             result.timing);
  fmt::print("page: {}\n", (fs::path(command.out) / "index.html").string());
  if (!command.json.empty()) {
    auto json = to_json(result);
    json["detections"] = detections;
    json["threshold"] = command.threshold;
    json["detections_by_part"] = by_part;
    write_text_file(command.json, json.dump(2) + "\n");
  }
  return result.good() ? 0 : 1;
}

}  // namespace weft
