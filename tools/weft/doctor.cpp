#include "tools/weft/doctor.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <set>
#include <sstream>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"
#include "stage/channels.hpp"
#include "stage/lcm_url.hpp"
#include "stage/net_namespace.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using Kind = Finding::Kind;

std::string joined(const std::set<std::string>& list) {
  std::string text;
  for (const auto& each : list) text += (text.empty() ? "" : ", ") + each;
  return text;
}

/// A line of a file in /sys, without its end.
std::string sys_line(const fs::path& file) {
  auto text = read_text_file(file);
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text;
}

}  // namespace

std::vector<Finding> check_cameras(const std::string& devices, const std::string& nodes) {
  // Depth cameras that OpenNI2 drives, by USB vendor and product ("" for any).
  static const std::pair<const char*, const char*> known[] = {
      {"1d27", ""}, {"045e", "02ae"}, {"045e", "02bf"}, {"2bc5", ""}};
  std::vector<Finding> findings;
  std::error_code none;
  for (const auto& device : fs::directory_iterator(devices, none)) {
    const auto vendor = sys_line(device.path() / "idVendor");
    const auto product = sys_line(device.path() / "idProduct");
    const bool camera = std::any_of(std::begin(known), std::end(known), [&](const auto& each) {
      return vendor == each.first && (*each.second == '\0' || product == each.second);
    });
    if (!camera) continue;
    const auto node = fmt::format("{}/{:0>3}/{:0>3}", nodes, sys_line(device.path() / "busnum"),
                                  sys_line(device.path() / "devnum"));
    const auto name = fmt::format("depth camera {}:{} at {}", vendor, product, node);
    if (access(node.c_str(), R_OK | W_OK) == 0) {
      findings.push_back({Kind::kGood, name + " may be used", ""});
    } else {
      findings.push_back(
          {Kind::kBad, name + " may not be opened by this user",
           fmt::format("echo 'SUBSYSTEM==\"usb\", ATTR{{idVendor}}==\"{}\", MODE=\"0666\"' | sudo "
                       "tee /etc/udev/rules.d/60-weft-camera.rules && sudo udevadm control "
                       "--reload && sudo udevadm trigger",
                       vendor)});
    }
  }
  if (findings.empty())
    findings.push_back({Kind::kGood, "no depth camera is plugged in: only logs and data sets", ""});
  return findings;
}

namespace {

Finding check_disk(const std::string& folder, double bytes_per_s) {
  constexpr double kVga_bytes_per_s = 6e6;  // 640x480, 30 frames a second, compressed
  constexpr double kEnough_s = 600;
  struct statvfs info {};
  if (statvfs(folder.c_str(), &info) != 0)
    return {Kind::kWarning, folder + ": cannot tell how much space is left", "mkdir -p " + folder};
  const bool heard = bytes_per_s > 0;
  if (!heard) bytes_per_s = kVga_bytes_per_s;
  const double free = static_cast<double>(info.f_bavail) * static_cast<double>(info.f_frsize);
  const auto text =
      fmt::format("{:.1f} GB are free in {}: {:.0f} minutes of recording at {:.1f} MB/s ({})",
                  free * 1e-9, folder, free / bytes_per_s / 60, bytes_per_s * 1e-6,
                  heard ? "as heard now" : "VGA at 30 Hz; no frames are on the air");
  if (free > kEnough_s * bytes_per_s) return {Kind::kGood, text, ""};
  return {Kind::kWarning, text,
          fmt::format("ls -lhS {0}/*.lcm shows the largest logs there, rm removes one; or weft "
                      "record on another disk, with {1:.1f} GB free at least: df -h",
                      folder, kEnough_s * bytes_per_s * 1e-9)};
}

Finding check_lan_route(const stage::LcmUrl& url) {
  std::string table;
  {
    std::ifstream file("/proc/net/route");
    table.assign(std::istreambuf_iterator<char>(file), {});
  }
  const auto interface = route_interface(table, url.group);
  if (interface != "lo" && !interface.empty())
    return {Kind::kGood, "messages to the LAN leave over " + interface, ""};
  const auto outward = route_interface(table, "1.1.1.1");
  return {Kind::kBad,
          interface.empty() ? "no route leads messages to the LAN"
                            : "the multicast route leads to lo: no message reaches the LAN",
          "sudo ip route replace 224.0.0.0/4 dev " +
              (outward.empty() ? "NAME (of the LAN's interface: ip -brief link)" : outward)};
}

std::vector<Finding> check_fragments(const stage::LcmUrl& url) {
  if (url.ttl == 0) return {};
  const auto memory = stage::FragmentMemory::of_kernel();
  const auto warning = stage::fragment_warning(url, memory);
  if (warning.empty())
    return {{Kind::kGood,
             fmt::format("pieces of messages that lost a packet wait {} s in {:.0f} MB",
                         memory.time_s, static_cast<double>(memory.bytes) * 1e-6),
             ""}};
  const auto remedy = warning.find(". Remedy: ");
  return {{Kind::kWarning, warning.substr(0, remedy), warning.substr(remedy + 10)}};
}

struct Made {
  const ProcessSpec& process;
  std::unique_ptr<stage::Stage> stage;
};

/// Nothing where the files it needs are not here.
std::unique_ptr<stage::Stage> make_quietly(const ProcessSpec& process,
                                           const StageRegistry& registry) {
  const auto factory = registry.find(process.exec);
  if (factory == registry.end()) return nullptr;
  try {
    return factory->second(settings_of(process));
  } catch (const Error&) {
    return nullptr;
  }
}

/// Models that were trained with another vocabulary than the one that makes their words.
std::vector<Finding> models_that_do_not_fit(const std::vector<Made>& all, const ProcessSet& set) {
  std::vector<Finding> findings;
  std::map<std::string, const Made*> makers;  // by channel on the wire
  for (const auto& made : all)
    for (const auto& port : made.stage->interface().outputs)
      makers[stage::wire_channel(made.process.map, port.channel)] = &made;
  for (const auto& made : all) {
    for (const auto& port : made.stage->interface().inputs) {
      const auto channel = stage::wire_channel(made.process.map, port.channel);
      const auto maker = makers.find(channel);
      if (port.maker_model_hash == 0 || maker == makers.end()) continue;
      const auto makes = maker->second->stage->interface().model_hash;
      if (makes == port.maker_model_hash) continue;
      findings.push_back(
          {Kind::kBad,
           fmt::format("{}: its model was trained with the vocabulary {}, but {} makes {} with {}",
                       made.process.name, to_hex(port.maker_model_hash),
                       maker->second->process.name, channel, to_hex(makes)),
           fmt::format("in {}, under with: of {} and {}: a model and a vocabulary from the same "
                       "folder of config/models",
                       set.file.string(), made.process.name, maker->second->process.name)});
    }
  }
  return findings;
}

}  // namespace

std::vector<Finding> mixed_versions(const std::vector<weft::stage_status_t>& statuses) {
  std::vector<Finding> findings;
  std::map<std::string, std::set<std::string>> processes, builds;
  struct End {
    std::string stage, type;
    std::int64_t fingerprint = 0;
  };
  std::map<std::string, std::vector<End>> channels;
  // Instances of one name before the '@' are variants on purpose; others of one name were found.
  std::map<std::string, std::set<std::string>> models;
  for (const auto& status : statuses) {
    // One that ended before the other of its name and host began is no mistake but its past.
    if (std::any_of(statuses.begin(), statuses.end(), [&](const weft::stage_status_t& other) {
          return other.stage == status.stage && other.host == status.host &&
                 other.started_utime > status.header.utime;
        }))
      continue;
    models[status.stage].insert(to_hex(static_cast<std::uint64_t>(status.model_hash)));
    const auto process = fmt::format("{} (process {})", status.host, status.pid);
    processes[status.stage].insert(process);
    builds[status.build].insert(status.stage);
    for (const auto& port : status.fingerprints)
      channels[port.channel].push_back({status.stage, port.type, port.fingerprint});
  }
  for (const auto& [stage, where] : processes) {
    if (where.size() > 1)
      findings.push_back({Kind::kBad, "several processes are " + stage + ": " + joined(where),
                          "stop one, give it another name, or give its set another prefix, group "
                          "or port under lcm: so that the sets do not hear each other"});
  }
  for (const auto& [channel, ends] : channels) {
    for (const auto& end : ends) {
      if (end.fingerprint == ends.front().fingerprint) continue;
      findings.push_back(
          {Kind::kBad,
           fmt::format("{}: {} takes it for {} {}, {} for {} {}; its messages do not decode",
                       channel, ends.front().stage, ends.front().type,
                       to_hex(static_cast<std::uint64_t>(ends.front().fingerprint)), end.stage,
                       end.type, to_hex(static_cast<std::uint64_t>(end.fingerprint))),
           "build both from the same lcmtypes/, or map one of them to another channel"});
      break;
    }
  }
  if (builds.size() > 1) {
    std::string text = "several builds run together:";
    for (const auto& [build, stages] : builds) text += " " + build + " (" + joined(stages) + ")";
    findings.push_back({Kind::kWarning, text, "update and build on every host: ./weft build"});
  }
  for (const auto& [stage, hashes] : models) {
    if (hashes.size() > 1)
      findings.push_back({Kind::kBad, stage + " runs with several models: " + joined(hashes),
                          "copy one config/models folder to every host"});
  }
  return findings;
}

std::vector<Finding> differences_from_files(const ProcessSet& set, const StageRegistry& registry,
                                            const std::vector<weft::stage_status_t>& statuses) {
  std::vector<Finding> findings;
  for (const auto& process : set.processes) {
    std::unique_ptr<stage::Stage> made;
    for (const auto& status : statuses) {
      if (status.stage != process.name) continue;
      if (!made) made = make_quietly(process, registry);
      if (!made) break;  // check_set() says so where the files must be
      const auto compare = [&](const char* what, std::int64_t reported, std::uint64_t here) {
        const auto there = static_cast<std::uint64_t>(reported);
        if (there == here) return;
        findings.push_back(
            {Kind::kBad,
             fmt::format("{} on {} (process {}) runs with {} {}, but {} makes {} here",
                         status.stage, status.host, status.pid, what, to_hex(there),
                         set.file.string(), to_hex(here)),
             fmt::format("give every host the same set, settings and models, then on {}: weft down "
                         "and weft up (weft restart {} where the set file is the same)",
                         status.host, status.stage)});
      };
      compare("settings", status.settings_hash, made->interface().settings_hash);
      compare("models", status.model_hash, made->interface().model_hash);
    }
  }
  return findings;
}

std::vector<Finding> silent_hosts(const ProcessSet& set, const std::string& this_host,
                                  const std::vector<weft::stage_status_t>& statuses) {
  std::set<std::string> heard;
  for (const auto& status : statuses) heard.insert(status.stage);
  bool any = false;
  std::map<std::string, std::set<std::string>> silent;  // by host
  for (const auto& process : set.processes) {
    if (heard.contains(process.name))
      any = true;
    else if (!process.source && !process.host.empty() && process.host != this_host)
      silent[process.host].insert(process.name);
  }
  std::vector<Finding> findings;
  if (!any) return findings;
  for (const auto& [host, names] : silent) {
    findings.push_back(
        {Kind::kBad, fmt::format("nothing is heard of {} on {}", joined(names), host),
         fmt::format(
             "on {0}: weft status; if the set is down there: weft up {1}; if it is up: weft "
             "doctor {1} on both hosts, and let UDP to {2} port {3} through their firewalls "
             "and the switch between them (with IGMP snooping it needs a querier)",
             host, set.file.filename().string(), set.group, set.port)});
  }
  return findings;
}

std::string route_interface(const std::string& table, const std::string& address) {
  in_addr wanted{};
  if (inet_pton(AF_INET, address.c_str(), &wanted) != 1) return {};
  std::string best;
  std::pair<std::uint32_t, long> rank{0, 0};  // longest mask, then smallest metric
  std::istringstream lines(table);
  std::string line;
  std::getline(lines, line);  // the head
  while (std::getline(lines, line)) {
    std::istringstream fields(line);
    std::string interface, destination, gateway, flags, references, use, mask;
    long metric = 0;
    if (!(fields >> interface >> destination >> gateway >> flags >> references >> use >> metric >>
          mask))
      continue;
    // Both as they lie in memory, so that they compare with wanted.s_addr.
    const auto to = static_cast<std::uint32_t>(std::strtoul(destination.c_str(), nullptr, 16));
    const auto bits = static_cast<std::uint32_t>(std::strtoul(mask.c_str(), nullptr, 16));
    const std::pair<std::uint32_t, long> ranked{ntohl(bits), -metric};
    if ((wanted.s_addr & bits) != to || (!best.empty() && ranked <= rank)) continue;
    best = interface;
    rank = ranked;
  }
  return best;
}

std::vector<Finding> check_set(const ProcessSet& set, const StageRegistry& registry,
                               const std::string& host, const std::set<std::string>& running) {
  std::vector<Finding> findings;
  std::set<std::string> hosts;
  std::vector<Made> all_made;
  for (const auto& process : set.processes) {
    if (!process.host.empty()) hosts.insert(process.host);
    if (!process.host.empty() && process.host != host) {
      if (auto made = make_quietly(process, registry))
        all_made.push_back({process, std::move(made)});
      continue;
    }
    try {
      find_program(set, process);
      const auto factory = registry.find(process.exec);
      const bool own = process.exec.find('/') != std::string::npos;
      if (factory == registry.end() && (own || running.contains(process.name))) {
        findings.push_back({Kind::kGood, process.name + ": its program is there", ""});
        continue;
      }
      if (factory == registry.end()) {
        auto command = command_line(set, process, url_of(set).to_string(), set.lock_step);
        command.emplace_back("--check");
        const auto result = run_command(command);
        if (result.status != 0) {
          const auto output = with_places(process, result.output);
          const auto at = output.find("error: ");
          const auto from = at == std::string::npos ? 0 : at + 7;
          throw Error(output.substr(from, output.find('\n', from) - from));
        }
        findings.push_back({Kind::kGood, process.name + ": program, settings and source", ""});
        continue;
      }
      auto made = factory->second(settings_of(process));
      const auto models = made->interface().model_hash;
      all_made.push_back({process, std::move(made)});
      findings.push_back(
          {Kind::kGood,
           process.name + (models == 0 ? ": program and settings"
                                       : ": program, settings and models, hash " + to_hex(models)),
           ""});
    } catch (const Error& e) {
      const std::string what = e.what();
      const bool model = what.find(".blob") != std::string::npos;
      findings.push_back(
          {Kind::kBad, process.name + ": " + what,
           model
               ? "git checkout -- config/models brings back the models that ship, ls config/models "
                 "shows which; others: weft train, and their path under with: in " +
                     set.file.string()
               : "put right what the message names in " + set.file.string() +
                     " or the settings it names"});
    }
  }
  for (auto& finding : models_that_do_not_fit(all_made, set))
    findings.push_back(std::move(finding));
  if (hosts.size() > 1 && set.ttl == 0)
    findings.push_back({Kind::kBad,
                        "the set runs on several hosts (" + joined(hosts) +
                            "), but its messages do not leave this one",
                        "in " + set.file.string() + ": lan: true"});
  if (set.ttl > 1)
    findings.push_back({Kind::kWarning,
                        fmt::format("ttl {} carries the messages beyond this LAN", set.ttl),
                        "in " + set.file.string() + ": lan: true without lcm: {ttl: ...}"});
  return findings;
}

std::vector<Finding> check_machine(const stage::LcmUrl& url, const std::string& record_folder,
                                   double record_bytes_per_s) {
  std::vector<Finding> findings;
  std::string why;
  if (stage::multicast_works(why)) {
    findings.push_back({Kind::kGood, "multicast messages come back to this machine", ""});
  } else {
    findings.push_back({Kind::kBad, "no multicast: " + why,
                        "sudo ip link set lo up multicast on && sudo ip route add 224.0.0.0/4 dev "
                        "lo (this machine alone; for a LAN: dev and the name of its interface)"});
  }
  const int limit = stage::receive_buffer_limit();
  const auto warning = stage::receive_buffer_warning(url, limit);
  const std::string setting = "net.core.rmem_max=" + std::to_string(url.recv_buf_size);
  findings.push_back(
      warning.empty()
          ? Finding{Kind::kGood,
                    fmt::format("receive buffers of {} bytes are granted", url.recv_buf_size), ""}
          : Finding{Kind::kWarning,
                    fmt::format("receive buffers are limited to {} bytes, {} are wanted: messages "
                                "may get lost in bursts",
                                limit, url.recv_buf_size),
                    "sudo sysctl -w " + setting + "; to keep it: echo " + setting +
                        " | sudo tee /etc/sysctl.d/60-weft.conf"});
  for (auto& finding : check_cameras()) findings.push_back(std::move(finding));
  if (url.is_udpm() && url.ttl > 0) findings.push_back(check_lan_route(url));
  for (auto& finding : check_fragments(url)) findings.push_back(std::move(finding));
  findings.push_back(check_disk(record_folder, record_bytes_per_s));
  return findings;
}

weft::header_t ClockExchange::question(std::int64_t now_us) {
  weft::header_t header{};
  header.utime = now_us;
  header.session = session_;
  header.seq = static_cast<std::int64_t>(sent_us_.size());
  sent_us_.push_back(now_us);
  return header;
}

void ClockExchange::take(const weft::clock_pong_t& pong, std::int64_t now_us) {
  const auto& [utime, camera, session, seq, frame] = pong.header;
  if (session != session_ || seq < 0 || seq >= static_cast<std::int64_t>(sent_us_.size())) return;
  // Anybody may answer: within these bounds no difference overflows.
  constexpr std::int64_t kLatest_us = std::int64_t{1} << 60;
  if (pong.received_utime < 0 || pong.answered_utime < pong.received_utime ||
      pong.answered_utime > kLatest_us || pong.set_by_us < -kLatest_us ||
      pong.set_by_us > kLatest_us)
    return;
  const std::int64_t sent_us = sent_us_[static_cast<std::size_t>(seq)];
  const std::int64_t there = pong.received_utime - sent_us, back = now_us - pong.answered_utime;
  const std::int64_t on_the_way = there + back;
  if (on_the_way < 0) return;
  auto& host = hosts_[pong.host];
  if (host.exchanges++ == 0 || on_the_way < host.on_the_way_us) {
    host.on_the_way_us = on_the_way;
    host.offset_us = (there - back) / 2;
  }
  set_by_us_[pong.stage] = {pong.host, pong.set_by_us};
}

std::vector<Finding> ClockExchange::findings(const std::string& this_host,
                                             const std::set<std::string>& heard) const {
  constexpr std::int64_t kApart_us = 5000;
  std::vector<Finding> findings;
  const auto ms = [](std::int64_t us) { return std::abs(static_cast<double>(us)) * 1e-3; };
  for (const auto& host : heard) {
    if (host != this_host && !hosts_.contains(host))
      findings.push_back({Kind::kWarning,
                          "clock of " + host + ": no process there answers CLOCK_PING",
                          "on " + host + ": build this version, ./weft build, and weft up again"});
  }
  for (const auto& [name, host] : hosts_) {
    if (name == this_host) continue;
    const auto uncertain = host.on_the_way_us / 2;
    const auto how = fmt::format(
        "clock of {}: {:.2f} ms {} this one's (+- {:.2f} ms, the best of "
        "{} exchanges)",
        name, ms(host.offset_us), host.offset_us < 0 ? "behind" : "ahead of", ms(uncertain),
        host.exchanges);
    if (std::abs(host.offset_us) - uncertain <= kApart_us) {
      findings.push_back({Kind::kGood, how, ""});
      continue;
    }
    findings.push_back(
        {Kind::kWarning, how + "; latencies across hosts are wrong by that",
         fmt::format("on {0}: sudo apt-get install -y chrony && printf 'local stratum "
                     "10\\nallow\\n' | sudo tee /etc/chrony/conf.d/weft.conf && sudo systemctl "
                     "restart chrony; on {1}: sudo apt-get install -y chrony && echo 'server {0} "
                     "iburst' | sudo tee /etc/chrony/sources.d/weft.sources && sudo chronyc reload "
                     "sources && sudo chronyc makestep; then weft down and weft up there",
                     this_host, name)});
  }
  for (const auto& [stage, where] : set_by_us_) {
    if (std::abs(where.second) <= kApart_us) continue;
    findings.push_back({Kind::kWarning,
                        fmt::format("{} on {} began before the clock there was set by {:.1f} ms, "
                                    "and stamps its messages by the old one",
                                    stage, where.first, static_cast<double>(where.second) * 1e-3),
                        "on " + where.first + ": weft restart " + stage});
  }
  return findings;
}

}  // namespace weft
