#include "tools/weft/process_set.hpp"

#include <fmt/format.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "base/error.hpp"
#include "base/project.hpp"
#include "stage/lcm_url.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

/// A YAML map with these keys and no others, each at most once.
class StrictMap {
 public:
  StrictMap(const YAML::Node& node, std::string file, std::string what,
            const std::set<std::string>& keys)
      : node_(node), file_(std::move(file)), what_(std::move(what)) {
    if (!node_.IsMap()) fail(node_, what_ + " must be a map (key: value lines)");
    std::string known;
    for (const auto& each : keys) known += (known.empty() ? "" : ", ") + each;
    std::set<std::string> seen;
    for (const auto& entry : node_) {
      const auto key = key_of(entry.first);
      if (!keys.contains(key))
        fail(entry.first, "unknown key '" + key + "' in " + what_ + "; expected one of: " + known);
      if (!seen.insert(key).second) fail(entry.first, "key '" + key + "' stands twice in " + what_);
    }
  }

  template <class T>
  T get(const char* key, const T& otherwise, const char* expected) {
    const YAML::Node child = find(key);
    return child ? convert<T>(child, key, expected) : otherwise;
  }
  template <class T>
  T need(const char* key, const char* expected) {
    const YAML::Node child = find(key);
    if (!child) fail(node_, what_ + " has no key '" + key + "'; expected " + expected);
    return convert<T>(child, key, expected);
  }
  int integer(const char* key, int otherwise, int low, int high) {
    const std::string expected =
        "a whole number from " + std::to_string(low) + " to " + std::to_string(high);
    const int value = get<int>(key, otherwise, expected.c_str());
    if (value < low || value > high)
      fail(find(key), std::string(key) + " is " + std::to_string(value) + "; expected " + expected);
    return value;
  }
  YAML::Node find(const char* key) const {
    for (const auto& entry : node_) {
      if (key_of(entry.first) == key) return entry.second;
    }
    return YAML::Node(YAML::NodeType::Undefined);
  }
  std::string key_of(const YAML::Node& key) const {
    if (!key.IsScalar()) fail(key, "a key of " + what_ + " must be a word");
    return key.Scalar();
  }
  std::string place(const YAML::Node& at) const {
    const int line = at.Mark().line;
    return file_ + (line >= 0 ? ":" + std::to_string(line + 1) : "");
  }
  [[noreturn]] void fail(const YAML::Node& at, const std::string& text) const {
    throw Error(place(at) + ": " + text);
  }

 private:
  template <class T>
  T convert(const YAML::Node& child, const char* key, const char* expected) {
    try {
      return child.as<T>();
    } catch (const YAML::Exception&) {
      fail(child, std::string(key) + " of " + what_ + " must be " + expected);
    }
  }
  YAML::Node node_;
  std::string file_;
  std::string what_;
};

void check_channel(const StrictMap& map, const YAML::Node& at, const std::string& channel) {
  const bool plain = std::all_of(channel.begin(), channel.end(), [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '@' || c == '-' || c == '.';
  });
  if (channel.empty() || channel.size() > 63 || !plain)
    map.fail(at, "'" + channel + "' is not a channel: 1 to 63 letters, digits, _ @ - or .");
}

void check_name(const StrictMap& map, const YAML::Node& at, const std::string& name) {
  const bool plain = std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-' || c == '@';
  });
  if (name.empty() || name.size() > 48 || !plain)
    map.fail(at, "'" + name + "' is not a name: 1 to 48 letters, digits, _ @ or -");
}

// Nested settings as assignments that Settings::set takes: "group.key=value".
void flatten(const StrictMap& map, const YAML::Node& node, const std::string& path,
             ProcessSpec& process) {
  if (node.IsMap()) {
    for (const auto& entry : node) {
      const auto key = map.key_of(entry.first);
      flatten(map, entry.second, path.empty() ? key : path + "." + key, process);
    }
    return;
  }
  if (!node.IsScalar() && !node.IsSequence()) map.fail(node, "with: " + path + " has no value");
  // A text is quoted again where YAML would take it for something else.
  YAML::Emitter text;
  if (node.IsScalar())
    text << node.Scalar();
  else
    text << YAML::Flow << node;
  process.with.push_back(path + "=" + text.c_str());
  process.with_places[process.with.back()] = map.place(node);
}

ProcessSpec read_process(const YAML::Node& node, const fs::path& file) {
  StrictMap map(node, file.string(), "a process",
                {"name", "exec", "settings", "with", "map", "host", "queue", "deadline_ms",
                 "source", "stop_wait_s", "camera", "trigger", "rate_hz"});
  ProcessSpec process;
  process.name = map.need<std::string>("name", "a name");
  check_name(map, node, process.name);
  process.exec = map.need<std::string>("exec", "a program beside weft, or a path");
  if (process.exec.empty())
    map.fail(node, "exec is empty; expected a program beside weft, or a path");
  const auto settings = map.get<std::string>("settings", "", "the path of a settings file");
  if (!settings.empty()) {
    process.settings = fs::absolute(file.parent_path() / settings).lexically_normal();
    if (!fs::is_regular_file(process.settings))
      map.fail(map.find("settings"), "settings file " + process.settings.string() +
                                         " does not exist (paths are relative to the set file)");
  }
  if (const YAML::Node with = map.find("with")) {
    if (!with.IsMap()) map.fail(with, "with must be a map of settings");
    flatten(map, with, "", process);
  }
  if (const YAML::Node channels = map.find("map")) {
    if (!channels.IsMap()) map.fail(channels, "map must be a map CHANNEL: OTHER");
    for (const auto& entry : channels) {
      const auto from = map.key_of(entry.first);
      const auto to = entry.second.IsScalar() ? entry.second.Scalar() : "";
      check_channel(map, entry.first, from);
      check_channel(map, entry.second, to);
      process.map[from] = to;
    }
  }
  process.host = map.get<std::string>("host", "", "a host name");
  process.source = map.get<bool>("source", false, "true or false");
  process.queue = map.integer("queue", 0, 0, 10000);
  process.deadline_ms = map.integer("deadline_ms", 0, 0, 600000);
  process.stop_wait_s = map.integer("stop_wait_s", 5, 1, 600);
  for (const char* key : {"camera", "trigger", "rate_hz"}) {
    if (const YAML::Node node_of_key = map.find(key); node_of_key && !process.source)
      map.fail(node_of_key, std::string(key) + " is for a process with source: true");
  }
  process.camera = map.get<std::string>("camera", "", "the name of a camera");
  if (map.find("camera")) check_name(map, map.find("camera"), process.camera);
  process.trigger = map.get<std::string>("trigger", "", "continuous, single or message");
  if (map.find("trigger") && process.trigger != "continuous" && process.trigger != "single" &&
      process.trigger != "message")
    map.fail(map.find("trigger"),
             "trigger is '" + process.trigger + "'; expected continuous, single or message");
  process.rate_hz = map.get<double>("rate_hz", 0, "frames a second, 0 to 1000");
  if (!(process.rate_hz >= 0 && process.rate_hz <= 1000))
    map.fail(map.find("rate_hz"), "rate_hz must be 0 to 1000 frames a second");
  return process;
}

}  // namespace

ProcessSet ProcessSet::from_file(const fs::path& file) {
  std::ifstream in(file);
  std::ostringstream text;
  if (!fs::is_regular_file(file) || !in || !(text << in.rdbuf()))
    throw Error(file.string() +
                ": cannot read the process set; ready-made ones are in config/sets/");
  return from_text(text.str(), file);
}

ProcessSet ProcessSet::from_text(const std::string& text, const fs::path& file) {
  YAML::Node root;
  try {
    root = YAML::Load(text);
  } catch (const YAML::Exception& e) {
    throw Error(file.string() + ":" + std::to_string(e.mark.line + 1) +
                ": not valid YAML: " + e.msg);
  }
  StrictMap map(root, file.string(), "the process set",
                {"name", "mode", "lan", "lcm", "log_bytes", "sources", "processes"});
  ProcessSet set;
  set.file = fs::absolute(file);
  set.name = map.get<std::string>("name", file.stem().string(), "a name");
  check_name(map, root, set.name);
  const auto mode = map.get<std::string>("mode", "live", "live or lock-step");
  if (mode != "live" && mode != "lock-step")
    map.fail(map.find("mode"), "mode is '" + mode + "'; expected live or lock-step");
  set.lock_step = mode == "lock-step";
  set.lan = map.get<bool>("lan", false, "true or false");
  set.ttl = set.lan ? 1 : 0;
  if (const YAML::Node node = map.find("lcm")) {
    StrictMap lcm(node, file.string(), "lcm", {"group", "port", "prefix", "ttl", "receive_buffer"});
    set.group = lcm.get<std::string>("group", set.group, "a multicast address");
    unsigned a = 0, b = 0, c = 0, d = 0;
    char rest = 0;
    if (std::sscanf(set.group.c_str(), "%3u.%3u.%3u.%3u%c", &a, &b, &c, &d, &rest) != 4 ||
        a < 224 || a > 239 || b > 255 || c > 255 || d > 255)
      lcm.fail(node, "group is '" + set.group + "'; expected 224.0.0.0 to 239.255.255.255");
    set.port = lcm.integer("port", set.port, 1024, 65535);
    set.ttl = lcm.integer("ttl", set.ttl, 0, 255);
    if ((set.ttl > 0) != set.lan)
      lcm.fail(lcm.find("ttl"), set.lan ? "ttl is 0, but the set says lan: true; leave ttl out"
                                        : "ttl is " + std::to_string(set.ttl) +
                                              ", but messages leave this host only when the set "
                                              "says lan: true (which makes the ttl 1)");
    set.prefix = lcm.get<std::string>("prefix", "", "a short name");
    if (const YAML::Node prefix = lcm.find("prefix")) {
      if (const auto fault = stage::prefix_fault(set.prefix); !fault.empty())
        lcm.fail(prefix, fault);
    }
    set.receive_buffer = lcm.integer("receive_buffer", set.receive_buffer, 65536, 1 << 30);
  }
  set.log_bytes = map.integer("log_bytes", set.log_bytes, 10'000, 1'000'000'000);
  if (const YAML::Node node = map.find("sources")) {
    set.sources = map.get<std::vector<std::string>>("sources", {}, "a list of channels");
    for (const auto& channel : set.sources) check_channel(map, node, channel);
  }
  if (set.sources.empty())
    map.fail(root, "the set names no source channels; expected sources: [RGBD_FRAME]");
  const YAML::Node processes = map.find("processes");
  if (!processes || !processes.IsSequence() || processes.size() == 0)
    map.fail(processes ? processes : root, "expected processes: a list with at least one process");
  std::set<std::string> names;
  for (const auto& node : processes) {
    set.processes.push_back(read_process(node, set.file));
    if (!names.insert(set.processes.back().name).second)
      map.fail(node, "two processes are named '" + set.processes.back().name + "'");
  }
  return set;
}

ProcessSpec& ProcessSet::find(const std::string& process) {
  std::string known;
  for (auto& each : processes) {
    if (each.name == process) return each;
    known += (known.empty() ? "" : ", ") + each.name;
  }
  throw Error("set " + name + " has no process '" + process + "'; it has: " + known);
}

std::string with_places(const ProcessSpec& process, std::string text) {
  for (const auto& [assignment, place] : process.with_places) {
    const auto said = "--set " + assignment + ":";
    for (std::size_t at = 0; (at = text.find(said, at)) != std::string::npos;
         at += place.size() + 1)
      text.replace(at, said.size(), place + ":");
  }
  return text;
}

fs::path find_program(const ProcessSet& set, const ProcessSpec& process) {
  const bool is_path = process.exec.find('/') != std::string::npos;
  fs::path program =
      (is_path ? set.file.parent_path() / process.exec : program_folder() / process.exec)
          .lexically_normal();
  if (access(program.c_str(), X_OK) != 0 || !fs::is_regular_file(program)) {
    throw Error("process " + process.name + " of " + set.file.string() + ": no program " +
                program.string() +
                (is_path ? "" : "; build it, or give exec: a path with a '/' in it"));
  }
  return program;
}

std::vector<std::string> command_line(const ProcessSet& set, const ProcessSpec& process,
                                      const std::string& url, bool lock_step) {
  std::vector<std::string> args{find_program(set, process).string(), "--name", process.name,
                                "--url", url};
  if (!process.settings.empty()) {
    args.push_back("--settings");
    args.push_back(process.settings.string());
  }
  for (const auto& assignment : process.with) {
    args.push_back("--set");
    args.push_back(assignment);
  }
  for (const auto& [from, to] : process.map) {
    args.push_back("--map");
    args.push_back(from + "=" + to);
  }
  if (process.source) {  // waits for nobody and drops nothing
    const auto add = [&](const char* option, const std::string& value) {
      if (value.empty()) return;
      args.emplace_back(option);
      args.push_back(value);
    };
    add("--camera", process.camera);
    add("--trigger", process.trigger);
    if (process.rate_hz > 0) add("--rate", fmt::format("{}", process.rate_hz));
    return args;
  }
  if (lock_step) {
    args.push_back("--lock-step");
  } else {
    if (process.queue > 0) {
      args.push_back("--queue");
      args.push_back(std::to_string(process.queue));
    }
    if (process.deadline_ms > 0) {
      args.push_back("--deadline-ms");
      args.push_back(std::to_string(process.deadline_ms));
    }
  }
  return args;
}

}  // namespace weft
