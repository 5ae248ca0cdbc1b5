#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace weft {

/// One process of a set. Reference: config/sets/README.md.
struct ProcessSpec {
  std::string name;                // of the instance: unique in the set
  std::string exec;                // as in the file: a program's name, or a path with a '/'
  std::filesystem::path settings;  // absolute; empty: all defaults
  std::vector<std::string> with;   // "group.key=value", on top of the settings file
  std::map<std::string, std::string> with_places;  // of those that the set file holds: "file:line"
  std::map<std::string, std::string> map;  // channel as the stage knows it -> channel on the wire
  std::string host;                        // runs only there; empty: on every host
  bool source = false;                     // makes the source channels: a replay does not start it
  int queue = 0;                           // frames waiting at most, live mode; 0: stage's default
  int deadline_ms = 0;                     // wait for a frame's inputs, live mode; 0: default
  int stop_wait_s = 5;                     // grace after SIGINT before SIGKILL
  // Of a source; empty and 0: the program's own defaults.
  std::string camera;   // name of the camera, in the name of every frame
  std::string trigger;  // continuous, single (one frame, then done) or message
  double rate_hz = 0;   // frames a second
};

/// Processes that work together, and how they talk.
struct ProcessSet {
  std::filesystem::path file;
  std::string name;
  bool lock_step = false;  // how `weft up` runs it; replay and demo are always lock-step
  std::string group = "239.255.76.67";
  int port = 7667;
  bool lan = false;    // messages leave this host, and those of others are heard
  int ttl = 0;         // 0 exactly when not lan
  std::string prefix;  // of every channel's name on the wire: robots of one LAN; empty: none
  int receive_buffer = 4 * 1024 * 1024;  // bytes asked of the kernel
  int log_bytes =
      10 * 1024 * 1024;  // a process's log is put aside beyond it, and two such are kept
  std::vector<std::string> sources;    // channels a replay plays from the log
  std::vector<ProcessSpec> processes;  // in pipeline order

  /// Strict: throws Error (file:line: what was expected) on an unknown or repeated key, a wrong
  /// type, a value out of range, a settings file that does not exist or two processes of one name.
  static ProcessSet from_file(const std::filesystem::path& file);
  static ProcessSet from_text(const std::string& text, const std::filesystem::path& file);

  /// Throws Error naming the known processes when there is none of that name.
  ProcessSpec& find(const std::string& process);
};

/// What a program says of a setting that it was given as --set (stage/process.hpp), with the place
/// in the set file instead.
std::string with_places(const ProcessSpec& process, std::string text);

/// The program of a process: beside this program's own file, or relative to the set file when it
/// has a '/'. Throws Error saying where it was looked for.
std::filesystem::path find_program(const ProcessSet& set, const ProcessSpec& process);

/// The command line that starts one process of the set.
std::vector<std::string> command_line(const ProcessSet& set, const ProcessSpec& process,
                                      const std::string& url, bool lock_step);

}  // namespace weft
