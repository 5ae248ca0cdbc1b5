#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <tuple>
#include <utility>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"
#include "stage/clock.hpp"
#include "stage/host.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/children.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/doctor.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/run_folder.hpp"
#include "tools/weft/timing_report.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"
#include "weft/status_t.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

/// A process that has started this often before it was ready will not get ready.
constexpr int kHopelessStarts = 4;

std::string this_host() {
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

/// Takes what has arrived on STAGE_STATUS. The older report of each stage stays, for rates.
struct Heard {
  weft::stage_status_t first, last;
};
/// A stage by name, host and process number: two of one name are a mistake to be shown.
using Everyone = std::map<std::tuple<std::string, std::string, std::int32_t>, weft::stage_status_t>;
/// From a frame's last input to its answer, ms, by stage.
using Latencies = std::map<std::string, std::vector<double>>;
void listen(Bus& bus, milliseconds time, std::map<std::string, Heard>& heard,
            Everyone* everyone = nullptr, Latencies* latencies = nullptr) {
  const auto message = bus.receive(time);
  if (!message) return;
  if (message->channel == stage::kTimingChannel) {
    const auto timing = decode_message<weft::stage_timing_t>(message->data);
    if (timing && latencies)
      (*latencies)[timing->stage].push_back(
          static_cast<double>(timing->published_utime - timing->received_utime) * 1e-3);
    return;
  }
  const auto status = decode_message<weft::stage_status_t>(message->data);
  if (!status) return;
  if (everyone) (*everyone)[{status->stage, status->host, status->pid}] = *status;
  auto [at, is_new] = heard.emplace(status->stage, Heard{*status, *status});
  if (at->second.last.header.session != status->header.session) at->second.first = *status;
  at->second.last = *status;
}

std::int64_t answered(const weft::stage_status_t& s) {
  return s.frames_out + s.frames_dropped + s.frames_failed + s.frames_missing_input;
}

std::string state_name(std::int8_t state) {
  switch (state) {
    case weft::stage_status_t::STARTING:
      return "starting";
    case weft::stage_status_t::RUNNING:
      return "running";
    case weft::stage_status_t::STOPPING:
      return "stopping";
    default:
      return "unknown";
  }
}

/// Whether a process was stopped with SIGSTOP.
bool is_suspended(pid_t pid) {
  std::string text;
  std::getline(std::ifstream(fmt::format("/proc/{}/stat", pid)), text);
  const auto at = text.rfind(") ");  // its name, in brackets, may hold anything
  return at != std::string::npos && at + 2 < text.size() && text[at + 2] == 'T';
}

}  // namespace

int up(const UpOptions& options) {
  catch_stop_signals();
  auto set = ProcessSet::from_file(options.set);
  const auto host = options.host.empty() ? this_host() : options.host;
  std::map<std::string, std::string> elsewhere;  // stages of other hosts, and their host
  std::erase_if(set.processes, [&](const ProcessSpec& process) {
    const bool here = process.host.empty() || process.host == host;
    if (!here && !process.source) elsewhere[process.name] = process.host;
    return !here;
  });
  if (set.processes.empty())
    throw Error("set " + set.name + " has no process for host " + host +
                "; give another with --host");
  RunFolder folder(run_root() / set.name);
  if (folder.running())
    throw Error("set " + set.name +
                " is running already; weft status shows it, weft down stops it");
  const auto url = url_of(set);
  const auto bus = make_lcm_bus(
      url, stage::kStatusChannel);  // before the processes, so that no report is missed
  folder.write(set, url.to_string(), set.lock_step);
  folder.start_supervisor();
  std::map<std::string, Heard> heard;
  std::map<std::string, std::int32_t> ready;  // and the process number; a source may be done by now
  const auto patience = milliseconds(static_cast<int>(options.ready_s * 1000));
  auto deadline = Clock::now() + patience;
  bool sources_started = false, told = false;
  std::optional<Clock::time_point> waits_since;  // for stages of other hosts
  try {
    for (auto checked = Clock::now();;) {
      listen(*bus, milliseconds(50), heard);
      std::string missing;
      std::vector<std::string> sources{"start"};
      for (const auto& process : set.processes) {
        if (process.source) sources.push_back(process.name);
        if (process.source && !sources_started) continue;
        const auto at = heard.find(process.name);
        if (at != heard.end() && (at->second.last.state == weft::stage_status_t::RUNNING ||
                                  (process.source && at->second.last.frames_out > 0)))
          ready[process.name] = at->second.last.pid;
        if (!ready.contains(process.name)) missing += (missing.empty() ? "" : ", ") + process.name;
      }
      if (missing.empty() && (sources_started || sources.size() == 1)) break;
      if (stop_requested()) throw Interrupted{};
      if (missing.empty()) {
        std::string absent;
        for (const auto& [name, where] : elsewhere) {
          const auto at = heard.find(name);
          if (at == heard.end() || at->second.last.state != weft::stage_status_t::RUNNING)
            absent += fmt::format("{}{} on {}", absent.empty() ? "" : ", ", name, where);
        }
        // The frames of a source that nobody hears are lost.
        if (!absent.empty() && Clock::now() < deadline) {
          if (!waits_since) waits_since = Clock::now();
          const bool quiet =
              Clock::now() - *waits_since < milliseconds(1500);  // they report each 1 s
          if (!quiet && !std::exchange(told, true))
            fmt::print(stderr, "waiting for {}: weft up there, too\n", absent);
          continue;
        }
        if (!absent.empty())
          fmt::print(stderr, "not heard after {} s: {}; starting the sources all the same\n",
                     options.ready_s, absent);
        folder.control(sources);
        sources_started = true;
        deadline = Clock::now() + patience;
        continue;
      }
      if (Clock::now() > deadline)
        throw Error(fmt::format("not ready after {} s: {}; weft logs NAME shows why",
                                options.ready_s, missing));
      if (Clock::now() - checked < milliseconds(500)) continue;
      checked = Clock::now();
      for (const auto& process : folder.processes()) {
        if (process.starts >= kHopelessStarts && !heard.contains(process.name))
          throw Error(
              "process " + process.name + " ends right after it starts:" +
              with_places(set.find(process.name), last_lines(folder.log(process.name), 12)));
      }
    }
  } catch (...) {
    folder.stop();
    throw;
  }
  fmt::print("{}: {} processes are running\n", set.name, set.processes.size());
  for (const auto& process : set.processes)
    fmt::print("  {:<20} process {}\n", process.name, ready.at(process.name));
  fmt::print("logs are in {}\n", folder.path().string());
  return 0;
}

int down(const std::string& set) {
  const auto folder = RunFolder::find(set);
  folder.stop();
  fmt::print("{} stopped\n", folder.path().filename().string());
  return 0;
}

int status(const StatusOptions& options, const StageRegistry& registry) {
  // A host that runs nothing of the set listens all the same, where the set file says.
  std::optional<RunFolder> folder;
  stage::LcmUrl url;
  std::string title, not_compared;
  std::optional<ProcessSet> set;
  if (fs::is_regular_file(options.set)) {
    set = ProcessSet::from_file(options.set);
    title = set->name;
    url = url_of(*set);
    if (fs::exists(run_root() / set->name / "set.json")) folder = RunFolder::find(set->name);
  } else {
    folder = RunFolder::find(options.set);
    title = folder->path().filename().string();
    url = stage::LcmUrl::parse(folder->url());
    try {
      set = ProcessSet::from_file(folder->set_file());
    } catch (const Error& e) {
      not_compared = e.what();
    }
  }
  std::vector<RunFolder::Process> processes;
  if (folder) processes = folder->processes();
  std::map<std::string, std::string> states;
  if (folder) states = folder->states();
  std::map<std::string, Heard> heard;
  Everyone everyone;
  Latencies latencies;
  std::string not_heard;
  try {
    const auto bus = make_lcm_bus(url, std::string("STAGE_(STATUS|TIMING)"));
    const auto end = Clock::now() + milliseconds(static_cast<int>(options.listen_s * 1000));
    while (Clock::now() < end) listen(*bus, milliseconds(50), heard, &everyone, &latencies);
  } catch (const Error& e) {
    not_heard = e.what();
  }
  const auto all_heard = heard;
  nlohmann::ordered_json json;
  const bool supervised = folder && folder->running();
  json["set"] = title;
  json["supervisor"] = supervised;
  bool all_well = (supervised || (!folder && !heard.empty())) && not_heard.empty();
  fmt::print(
      "{:<20} {:<12} {:>7} {:<9} {:>6} {:>7} {:>8} {:>8} {:>7} {:>6} {:>7} {:>6} {:>8} {:>7} "
      "{:>7}  {:<8} {:<8}  {}\n",
      "process", "host", "pid", "state", "starts", "up s", "in", "out", "dropped", "failed",
      "missing", "gaps", "frames/s", "p95 ms", "MB", "settings", "model", "last error");
  const auto show = [&](nlohmann::ordered_json& entry, const Heard& of, const std::string& starts) {
    const auto& [first, last] = of;
    const double seconds = static_cast<double>(last.header.utime - first.header.utime) * 1e-6;
    const double rate =
        seconds > 0 ? static_cast<double>(answered(last) - answered(first)) / seconds : 0;
    all_well = all_well && last.state == weft::stage_status_t::RUNNING;
    entry["host"] = last.host;
    entry["pid"] = last.pid;
    entry["state"] = state_name(last.state);
    entry["build"] = last.build;
    entry["settings_hash"] = to_hex(static_cast<std::uint64_t>(last.settings_hash));
    entry["model_hash"] = to_hex(static_cast<std::uint64_t>(last.model_hash));
    const double up_s = static_cast<double>(last.header.utime - last.started_utime) * 1e-6;
    entry["up_s"] = up_s;
    entry["frames_in"] = last.frames_in;
    entry["frames_out"] = last.frames_out;
    entry["frames_dropped"] = last.frames_dropped;
    entry["frames_failed"] = last.frames_failed;
    entry["frames_missing_input"] = last.frames_missing_input;
    entry["gaps"] = last.gaps;
    entry["decode_failures"] = last.decode_failures;
    entry["invalid_inputs"] = last.invalid_inputs;
    entry["frames_per_second"] = rate;
    // Of the frames answered while listening; none of them, no figure.
    const auto took = latencies.find(last.stage);
    std::string p95 = "-";
    if (took != latencies.end()) {
      entry["p95_ms"] = quantiles(took->second).p95;
      p95 = fmt::format("{:.1f}", quantiles(took->second).p95);
    }
    entry["resident_bytes"] = last.resident_bytes;
    entry["last_error"] = last.last_error;
    const auto short_hash = [](std::int64_t hash) {
      return hash == 0 ? "-" : to_hex(static_cast<std::uint64_t>(hash)).substr(0, 8);
    };
    fmt::print(
        "{:<20} {:<12} {:>7} {:<9} {:>6} {:>7.0f} {:>8} {:>8} {:>7} {:>6} {:>7} {:>6} {:>8.1f} "
        "{:>7} {:>7.1f}  {:<8} {:<8}  {}\n",
        last.stage, last.host, last.pid, state_name(last.state), starts, up_s, last.frames_in,
        last.frames_out, last.frames_dropped, last.frames_failed, last.frames_missing_input,
        last.gaps, rate, p95, static_cast<double>(last.resident_bytes) / 1e6,
        short_hash(last.settings_hash), short_hash(last.model_hash), last.last_error);
  };
  for (const auto& process : processes) {
    auto& entry = json["processes"][process.name];
    entry["pid"] = process.pid;
    entry["supervised"] = states[process.name];
    entry["starts"] = process.starts;
    const auto at = heard.find(process.name);
    if (process.pid == 0 && states[process.name] == "EXITED" && folder->is_source(process.name)) {
      entry["state"] = "finished";
      fmt::print("{:<20} {:<12} {:>7} {:<9} {:>6}  weft restart {} begins again\n", process.name,
                 "", "", "finished", process.starts, process.name);
      if (at != heard.end()) heard.erase(at);
      continue;
    }
    if (at == heard.end() || process.pid == 0) {
      all_well = false;
      const char* state = process.pid == 0 ? "stopped" : "silent";
      const auto why =
          process.pid == 0 ? fmt::format("supervisor says {}; weft logs {} shows why it ended",
                                         states[process.name], process.name)
          : is_suspended(process.pid)
              ? fmt::format("suspended by a signal; kill -CONT {} lets it go on", process.pid)
              : fmt::format("it runs and reports nothing; weft logs {0}, weft restart {0}",
                            process.name);
      fmt::print("{:<20} {:<12} {:>7} {:<9} {:>6}  {}\n", process.name, "", process.pid, state,
                 process.starts, why);
      entry["state"] = state;
      continue;
    }
    show(entry, at->second, std::to_string(process.starts));
    heard.erase(at);
  }
  // Those of other hosts, and of other sets on this group and port.
  json["elsewhere"] = nlohmann::ordered_json::object();
  for (const auto& [name, of] : heard) show(json["elsewhere"][name], of, "");
  std::vector<weft::stage_status_t> statuses;
  for (const auto& [key, each] : everyone) statuses.push_back(each);
  json["problems"] = nlohmann::ordered_json::array();
  auto problems = mixed_versions(statuses);
  if (set) {
    for (auto& finding : differences_from_files(*set, registry, statuses))
      problems.push_back(std::move(finding));
    for (auto& finding : silent_hosts(*set, this_host(), statuses))
      problems.push_back(std::move(finding));
  }
  for (const auto& [name, of] : all_heard) {
    const auto& [first, last] = of;
    const auto failed = last.frames_failed - first.frames_failed;
    if (failed > 0 && failed == answered(last) - answered(first)) {
      problems.push_back({Finding::Kind::kBad,
                          fmt::format("{} failed on each of the last {} frames: {}", name, failed,
                                      last.last_error),
                          "weft doctor " + (set ? set->file.string() : "SET.yaml") +
                              " looks for the reason; weft logs " + name + " has all it said"});
    }
  }
  for (const auto& finding : problems) {
    all_well = false;
    fmt::print("{}\n  remedy: {}\n", finding.what, finding.remedy);
    json["problems"].push_back(finding.what);
  }
  if (!folder) {
    fmt::print("this host runs nothing of {}; heard on {}: {} processes\n", title, url.to_string(),
               everyone.size());
  } else if (!supervised) {
    fmt::print(
        "the supervisor is not running; weft down cleans up, weft up starts the set again\n");
  }
  if (!not_compared.empty())
    fmt::print("settings and models are not compared with the set's files: {}\n", not_compared);
  if (!not_heard.empty()) fmt::print("cannot listen to the processes: {}\n", not_heard);
  if (!options.json.empty()) write_text_file(options.json, json.dump(2) + "\n");
  return all_well ? 0 : 1;
}

int logs(const LogsOptions& options) {
  const auto file = RunFolder::find(options.set).log(options.process);
  std::vector<std::string> command{"tail", "-n", std::to_string(options.lines)};
  if (options.follow) command.push_back("-F");
  command.push_back(file.string());
  std::vector<char*> args;
  for (const auto& arg : command) args.push_back(const_cast<char*>(arg.c_str()));
  args.push_back(nullptr);
  execvp(args[0], args.data());
  throw Error("cannot run tail");
}

int restart(const std::string& process, const std::string& set) {
  const auto folder = RunFolder::find(set);
  static_cast<void>(folder.log(process));  // knows the processes' names
  // One that came to its end cannot be stopped first.
  const auto state = folder.states()[process];
  const bool ended = state == "EXITED" || state == "STOPPED" || state == "FATAL";
  folder.forget_quick_deaths(process);
  folder.control({ended ? "start" : "restart", process});
  fmt::print("{} restarted\n", process);
  return 0;
}

int trigger_command(const TriggerOptions& options) {
  catch_stop_signals();
  const auto set = ProcessSet::from_file(fs::is_regular_file(options.set)
                                             ? fs::path(options.set)
                                             : RunFolder::find(options.set).set_file());
  const auto bus = make_lcm_bus(url_of(set));
  weft::header_t trigger{};
  trigger.camera = options.camera;
  trigger.session = trigger.utime = stage::now_us();
  const auto began = Clock::now();
  const auto wait = milliseconds(static_cast<int>(options.timeout_s * 1000));
  // A trigger may get lost; sent again it is the same one, and no camera obeys it twice.
  constexpr milliseconds kAgain{500};
  auto due = began;
  while (Clock::now() - began < wait && !stop_requested()) {
    if (Clock::now() >= due) {
      bus->publish(stage::kTriggerChannel, encode_message(trigger));
      due += kAgain;
    }
    const auto message = bus->receive(milliseconds(20));
    if (!message ||
        std::find(set.sources.begin(), set.sources.end(), message->channel) == set.sources.end())
      continue;
    const auto header = read_frame_header(message->data);
    if (!header || (!options.camera.empty() && header->frame.camera != options.camera)) continue;
    fmt::print("{}: frame {}\n", message->channel, to_string(header->frame));
    return header->status_code <= weft::status_t::NOTHING ? 0 : 1;
  }
  throw Error(fmt::format(
      "no frame came in {} s: does the set have a source with trigger: message"
      "{}, and is it running (weft status)?",
      options.timeout_s, options.camera.empty() ? "" : " and camera: " + options.camera));
}

}  // namespace weft
