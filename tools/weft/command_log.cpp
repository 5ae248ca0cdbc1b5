#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/log.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/log_tools.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/message_types.hpp"
#include "tools/weft/page.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/timing_report.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {
namespace {

void print_damage(const std::string& file, const stage::LogReader& log) {
  for (const auto& damage : log.damage())
    fmt::print(stderr, "{}: {} bytes skipped at byte {}: {}\n", file, damage.bytes, damage.offset,
               damage.what);
}

const MessageTypes& types_with(const std::string& folder) {
  static MessageTypes types = MessageTypes::built_in();
  if (!folder.empty()) types.add_folder(folder);
  return types;
}

void print_channels(const LogSurvey& survey) {
  fmt::print("{:<28} {:<20} {:>9} {:>8} {:>8} {:>10} {:>10} {:>7}\n", "channel", "type", "messages",
             "frames", "missing", "mean bytes", "largest", "not OK");
  for (const auto& [name, channel] : survey.channels) {
    fmt::print("{:<28} {:<20} {:>9} {:>8} {:>8} {:>10} {:>10} {:>7}\n", name,
               channel.type.empty() ? "?" : channel.type, channel.messages, channel.frames,
               channel.missing, channel.bytes / channel.messages, channel.largest, channel.not_ok);
  }
  fmt::print("\n");
  for (const auto& [key, range] : survey.sessions)
    fmt::print("camera {}, session {}: frames {} to {}\n", key.first, key.second, range.first,
               range.second);
}

nlohmann::ordered_json to_json(const LogSurvey& survey) {
  nlohmann::ordered_json json{{"events", survey.events},
                              {"bytes", survey.bytes},
                              {"seconds", survey.seconds()},
                              {"healthy", survey.healthy()},
                              {"problems_found", survey.problem_count},
                              {"skipped_bytes", survey.skipped_bytes},
                              {"faulty_events", survey.faulty_events},
                              {"backward_steps", survey.backward_steps},
                              {"number_jumps", survey.number_jumps}};
  json["channels"] = nlohmann::ordered_json::object();
  for (const auto& [name, channel] : survey.channels)
    json["channels"][name] = {{"type", channel.type},     {"messages", channel.messages},
                              {"frames", channel.frames}, {"missing", channel.missing},
                              {"bytes", channel.bytes},   {"largest", channel.largest},
                              {"not_ok", channel.not_ok}};
  json["sessions"] = nlohmann::ordered_json::array();
  for (const auto& [key, range] : survey.sessions)
    json["sessions"].push_back({{"camera", key.first},
                                {"session", key.second},
                                {"first", range.first},
                                {"last", range.second}});
  json["problems"] = nlohmann::ordered_json::array();
  for (const auto& problem : survey.problems)
    json["problems"].push_back(
        {{"byte", problem.offset}, {"bytes", problem.bytes}, {"what", problem.what}});
  return json;
}

std::string summary(const std::string& file, const LogSurvey& survey) {
  return fmt::format("{}: {} events, {:.1f} MB, {:.1f} s", file, survey.events,
                     static_cast<double>(survey.bytes) / 1e6, survey.seconds());
}

int print_copy(const std::string& out, const CopyCounts& counts) {
  for (const auto& damage : counts.damage)
    fmt::print(stderr, "skipped {} bytes at byte {}: {}\n", damage.bytes, damage.offset,
               damage.what);
  fmt::print("{}: {} of {} events", out, counts.written, counts.read);
  if (counts.left_out_faulty > 0) fmt::print(", {} faulty ones left out", counts.left_out_faulty);
  if (counts.copies > 0) fmt::print(", {} copies left out", counts.copies);
  fmt::print("\n");
  return 0;
}

}  // namespace

int timing_command(const std::string& file, const std::string& json, const std::string& html,
                   const std::string& trace) {
  stage::LogReader log(file);
  stage::LogEvent event;
  TimingCollector timing;
  std::size_t undecodable = 0;
  while (log.next(event)) {
    if (event.channel == stage::kStatusChannel) {
      if (const auto status = decode_message<weft::stage_status_t>(event.data)) timing.add(*status);
      continue;
    }
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
  if (!trace.empty()) {
    write_text_file(trace, to_chrome_trace(report));
    fmt::print("trace: {} (open it in chrome://tracing or ui.perfetto.dev)\n", trace);
  }
  if (!html.empty()) {
    write_text_file(html,
                    make_page("timing.html", {{"title", file}, {"timing", page_timing(report)}}));
    fmt::print("timeline: {}\n", html);
  }
  return log.damage().empty() && undecodable == 0 ? 0 : 1;
}

int log_info_command(const std::string& file, const std::string& json_file,
                     const std::string& types) {
  const auto survey = survey_log(file, types_with(types));
  fmt::print("{}\n\n", summary(file, survey));
  print_channels(survey);
  if (!survey.healthy())
    fmt::print("damaged: {} problems; weft log check lists them\n", survey.problem_count);
  if (!json_file.empty()) write_text_file(json_file, to_json(survey).dump(2) + "\n");
  return survey.healthy() ? 0 : 1;
}

int log_check_command(const std::string& file, const std::string& json_file,
                      const std::string& types) {
  constexpr std::size_t kShown = 50;
  const auto survey = survey_log(file, types_with(types));
  for (std::size_t i = 0; i < std::min(kShown, survey.problems.size()); ++i) {
    const auto& problem = survey.problems[i];
    fmt::print("byte {}: {} bytes: {}\n", problem.offset, problem.bytes, problem.what);
  }
  if (survey.problem_count > static_cast<std::int64_t>(kShown))
    fmt::print("and {} more\n", survey.problem_count - static_cast<std::int64_t>(kShown));
  std::int64_t missing = 0;
  for (const auto& [name, channel] : survey.channels) {
    if (channel.missing > 0)
      fmt::print("{}: {} of {} frames are not there\n", name, channel.missing,
                 channel.missing + channel.frames);
    missing += channel.missing;
  }
  if (survey.backward_steps > 0)
    fmt::print("time goes back {} times from one event to the next\n", survey.backward_steps);
  if (survey.number_jumps > 0)
    fmt::print("the numbering of events jumps {} times: the log was filtered, or lost some\n",
               survey.number_jumps);
  fmt::print("{}; {}\n", summary(file, survey),
             survey.healthy()
                 ? missing == 0 ? "healthy" : "healthy, with gaps"
                 : fmt::format("{} problems: {} bytes belong to no event, {} events "
                               "cannot be trusted; weft log repair keeps the rest",
                               survey.problem_count, survey.skipped_bytes, survey.faulty_events));
  if (!json_file.empty()) write_text_file(json_file, to_json(survey).dump(2) + "\n");
  return survey.healthy() ? 0 : 1;
}

int log_repair_command(const std::string& file, const std::string& out, const std::string& types) {
  return print_copy(out, repair_log(file, out, types_with(types)));
}

int log_filter_command(const std::string& file, const std::string& out, const LogFilter& filter) {
  return print_copy(out, filter_log(file, out, filter));
}

int log_cut_command(const std::string& file, const std::string& out, const LogRange& range) {
  if (!range.has_frames() && !range.has_times())
    throw Error("say what to cut out: --from-s, --to-s, --from-frame, --to-frame");
  return print_copy(out, cut_log(file, out, range));
}

int log_splice_command(const std::vector<std::string>& files, const std::string& out) {
  return print_copy(out, splice_logs(files, out));
}

int log_hash_command(const std::string& file) {
  for (const auto& line : payload_hashes(file)) fmt::print("{}\n", line);
  return 0;
}

}  // namespace weft
