#pragma once

#include <sys/types.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tools/weft/process_set.hpp"

namespace weft {

/// Processes started here, ended with this object, and never outliving this program.
class Children {
 public:
  /// Their output goes to FOLDER/NAME.log.
  explicit Children(std::filesystem::path folder);
  ~Children();
  Children(const Children&) = delete;
  Children& operator=(const Children&) = delete;

  void start(const ProcessSpec& process, const std::vector<std::string>& command);
  /// Starts again what a signal ended. Throws Error with the last lines of its output when a
  /// process ended by itself, or was ended more than 20 times.
  void check();
  /// SIGINT, then SIGKILL for what is still there after the grace.
  void stop();
  pid_t pid(const std::string& name) const { return running_.at(name).pid; }

 private:
  struct Child {
    pid_t pid = 0;
    std::vector<std::string> command;
    ProcessSpec process;
    int restarts = 0;
  };
  pid_t spawn(const std::string& name, const std::vector<std::string>& command) const;
  std::filesystem::path log_file(const std::string& name) const;
  std::filesystem::path folder_;
  std::map<std::string, Child> running_;
};

/// The last lines of a text file, indented, for an error message.
std::string last_lines(const std::filesystem::path& file, int count);

}  // namespace weft
