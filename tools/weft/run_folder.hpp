#pragma once

#include <sys/types.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tools/weft/process_set.hpp"

/// A running set: a private supervisord keeps its processes alive. Everything it needs is in one
/// folder, $XDG_RUNTIME_DIR/weft/SET, or out/run/SET where there is no such variable;
/// $WEFT_RUN_DIR overrides both.
namespace weft {

std::filesystem::path run_root();

class RunFolder {
 public:
  explicit RunFolder(std::filesystem::path folder);
  /// The one set that is running, or the one of that name or set file; throws Error otherwise.
  static RunFolder find(const std::string& set_or_empty);

  /// Writes configuration and start scripts. processes: those of this host.
  void write(const ProcessSet& set, const std::string& url, bool lock_step) const;
  void start_supervisor() const;
  /// Stops the processes, then the supervisor; also when the supervisor itself was killed.
  void stop() const;
  bool running() const;

  struct Process {
    std::string name;
    pid_t pid = 0;  // 0: not running
    int starts = 0;
  };
  std::vector<Process> processes() const;
  /// By process, as supervisord calls it: RUNNING, STOPPED, FATAL ... Asks it, which takes a while.
  std::map<std::string, std::string> states() const;
  /// supervisorctl with these arguments; throws Error with its output when it fails.
  std::string control(const std::vector<std::string>& args) const;

  std::string url() const;
  std::filesystem::path set_file() const;
  std::vector<std::string> names() const;
  bool is_source(const std::string& process) const;  // may come to its end
  std::filesystem::path log(const std::string& process) const;
  /// The next start comes without a rest.
  void forget_quick_deaths(const std::string& process) const;
  const std::filesystem::path& path() const { return folder_; }

 private:
  pid_t supervisor_pid() const;
  std::filesystem::path folder_;
};

/// supervisord.conf; every path in it is relative to its own folder.
std::string supervisor_config(const ProcessSet& set);

/// The shell script that starts one process: rests first when the process before ended soon after
/// its start, and not for the first time; notes the start and its process number, then becomes the
/// process.
std::string start_script(const std::string& name, const std::vector<std::string>& command,
                         const std::filesystem::path& folder);

/// Runs a program to its end. Returns its exit status and everything it wrote.
struct CommandResult {
  int status = 0;
  std::string output;
};
CommandResult run_command(const std::vector<std::string>& command);

}  // namespace weft
