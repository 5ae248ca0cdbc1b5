#include "tools/weft/children.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <deque>
#include <fstream>
#include <thread>

#include "base/error.hpp"

namespace weft {
namespace {
constexpr int kMostRestarts = 20;
constexpr std::chrono::seconds kStopGrace{5};
}  // namespace

std::string last_lines(const std::filesystem::path& file, int count) {
  std::ifstream in(file);
  std::deque<std::string> lines;
  for (std::string line; std::getline(in, line);) {
    lines.push_back(line);
    if (lines.size() > static_cast<std::size_t>(count)) lines.pop_front();
  }
  std::string text;
  for (const auto& line : lines) text += "\n    " + line;
  return text;
}

Children::Children(std::filesystem::path folder) : folder_(std::move(folder)) {
  std::filesystem::create_directories(folder_);
}

Children::~Children() { stop(); }

std::filesystem::path Children::log_file(const std::string& name) const {
  return folder_ / (name + ".log");
}

void Children::start(const ProcessSpec& process, const std::vector<std::string>& command) {
  std::filesystem::remove(log_file(process.name));
  running_[process.name] = {spawn(process.name, command), command, process};
}

pid_t Children::spawn(const std::string& name, const std::vector<std::string>& command) const {
  const int log = open(log_file(name).c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (log < 0) throw Error(log_file(name).string() + ": cannot write: " + std::strerror(errno));
  std::vector<char*> args;
  for (const auto& arg : command) args.push_back(const_cast<char*>(arg.c_str()));
  args.push_back(nullptr);
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) throw Error("cannot start " + name + ": " + std::strerror(errno));
  if (pid == 0) {
    // Only system calls from here to exec.
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(127);
    setpgid(0, 0);  // Ctrl-C reaches this program alone, which then stops the others in order
    const int null = open("/dev/null", O_RDONLY);
    dup2(null, STDIN_FILENO);
    dup2(log, STDOUT_FILENO);
    dup2(log, STDERR_FILENO);
    execv(args[0], args.data());
    _exit(127);
  }
  close(log);
  return pid;
}

void Children::check() {
  for (auto& [name, child] : running_) {
    int status = 0;
    if (waitpid(child.pid, &status, WNOHANG) != child.pid) continue;
    child.pid = 0;
    const std::string how = WIFSIGNALED(status)
                                ? "was ended by signal " + std::to_string(WTERMSIG(status))
                                : "ended with status " + std::to_string(WEXITSTATUS(status));
    if (!WIFSIGNALED(status) || ++child.restarts > kMostRestarts)
      throw Error("process " + name + " " + how + ":" +
                  with_places(child.process, last_lines(log_file(name), 12)) +
                  "\n  its whole output: " + log_file(name).string());
    child.pid = spawn(name, child.command);
  }
}

void Children::stop() {
  for (const auto& [name, child] : running_) {
    if (child.pid > 0) kill(child.pid, SIGINT);
  }
  const auto deadline = std::chrono::steady_clock::now() + kStopGrace;
  for (auto& [name, child] : running_) {
    if (child.pid <= 0) continue;
    while (waitpid(child.pid, nullptr, WNOHANG) == 0) {
      if (std::chrono::steady_clock::now() > deadline) {
        kill(child.pid, SIGKILL);
        waitpid(child.pid, nullptr, 0);
        break;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    child.pid = 0;
  }
  running_.clear();
}

}  // namespace weft
