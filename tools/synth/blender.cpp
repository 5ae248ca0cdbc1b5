#include "synth/blender.hpp"

#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <thread>

#include "base/error.hpp"

extern char** environ;

namespace weft::synth {
namespace {

/// What a child wrote, in memory: nothing is left behind, however this program ends.
class Output {
 public:
  Output() : file_(memfd_create("blender", MFD_CLOEXEC)) {
    if (file_ < 0)
      throw Error(std::string("cannot keep Blender's output: ") + std::strerror(errno));
  }
  ~Output() { close(file_); }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  int file() const { return file_; }

  std::string last_lines(int count) const {
    char buffer[4096];
    const off_t size = lseek(file_, 0, SEEK_END);
    const off_t start = std::max<off_t>(0, size - static_cast<off_t>(sizeof buffer));
    const auto got = pread(file_, buffer, sizeof buffer, start);
    std::string text(buffer, got > 0 ? static_cast<std::size_t>(got) : 0);
    while (!text.empty() && text.back() == '\n') text.pop_back();
    std::size_t at = text.size();
    while (count-- > 0 && at != std::string::npos && at > 0) at = text.rfind('\n', at - 1);
    return at == std::string::npos ? text : text.substr(at == 0 ? 0 : at + 1);
  }

 private:
  int file_;
};

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> out;
  for (auto& text : texts) out.push_back(text.data());
  out.push_back(nullptr);
  return out;
}

struct Ended {
  int status = 0;  // as waitpid() gives it
  bool stopped = false;
  std::string output;  // its last lines
};

/// Runs a program and waits for it.
Ended run(std::vector<std::string> command, const std::function<bool()>& stopped) {
  std::vector<std::string> environment = {"OMP_NUM_THREADS=1", "PYTHONDONTWRITEBYTECODE=1"};
  for (char** each = environ; *each != nullptr; ++each) {
    if (std::strncmp(*each, "OMP_", 4) != 0) environment.emplace_back(*each);
  }
  const auto argv = pointers(command), envp = pointers(environment);
  const Output output;
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child < 0) throw Error(std::string("cannot start Blender: ") + std::strerror(errno));
  if (child == 0) {
    // Only system calls from here to exec.
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(127);
    setpgid(0, 0);  // Ctrl-C reaches this program alone, which then stops the others
    const int null = open("/dev/null", O_RDONLY);
    dup2(null, STDIN_FILENO);
    dup2(output.file(), STDOUT_FILENO);
    dup2(output.file(), STDERR_FILENO);
    execve(argv[0], argv.data(), envp.data());
    _exit(127);
  }
  Ended ended;
  while (waitpid(child, &ended.status, WNOHANG) == 0) {
    if (stopped()) {
      kill(child, SIGKILL);  // it has nothing to put in order: its files appear whole or not at all
      waitpid(child, &ended.status, 0);
      ended.stopped = true;
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  ended.output = output.last_lines(12);
  return ended;
}

}  // namespace

std::string find_blender() {
  const char* path = std::getenv("PATH");
  std::string folders = path != nullptr ? path : "/usr/bin:/bin";
  for (std::size_t at = 0; at <= folders.size();) {
    const auto end = std::min(folders.find(':', at), folders.size());
    std::string file = folders.substr(at, end - at) + "/blender";
    if (access(file.c_str(), X_OK) == 0 && std::filesystem::is_regular_file(file)) return file;
    at = end + 1;
  }
  throw Error(
      "Blender is not installed, and only Blender can simulate garments; install it (Debian: "
      "apt-get install blender python3-numpy libgl1-mesa-dri, or run ./weft synth, which does it) "
      "and give the same command again");
}

std::string blender_version() {
  const auto ended = run({find_blender(), "--version"}, [] { return false; });
  const auto line = ended.output.substr(0, ended.output.find('\n'));
  if (ended.status != 0 || line.rfind("Blender ", 0) != 0)
    throw Error(find_blender() + " --version does not answer as Blender does: " + ended.output);
  return line;
}

BlenderEnd run_blender(const std::string& script, const std::vector<std::string>& arguments,
                       const std::function<bool()>& stopped) {
  std::vector<std::string> command = {find_blender(), "-b", "--factory-startup", "-t", "1", "-P",
                                      script,         "--"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  const auto ended = run(command, stopped);
  if (WIFEXITED(ended.status) && WEXITSTATUS(ended.status) == 0) return BlenderEnd::kDone;
  if (ended.stopped || stopped()) return BlenderEnd::kStopped;
  const int signal = WIFSIGNALED(ended.status) ? WTERMSIG(ended.status) : 0;
  for (const int fault : {SIGSEGV, SIGABRT, SIGBUS, SIGFPE, SIGILL}) {
    if (signal == fault) return BlenderEnd::kCrashed;
  }
  std::string text = "Blender ";
  for (const auto& each : arguments) text += each + " ";
  throw Error(text +
              (signal != 0 ? "was ended by signal " + std::to_string(signal)
                           : "ended with status " + std::to_string(WEXITSTATUS(ended.status))) +
              ":\n" + ended.output);
}

}  // namespace weft::synth
