#include "tools/weft/run_folder.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "base/error.hpp"
#include "base/text_file.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

constexpr const char* kConfig = "supervisord.conf";
constexpr const char* kSocket = "supervisor.sock";

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

nlohmann::json read_info(const fs::path& folder) {
  try {
    return nlohmann::json::parse(read_text_file(folder / "set.json"));
  } catch (const nlohmann::json::exception&) {
    throw Error((folder / "set.json").string() + ": not written by weft up; remove the folder");
  }
}

bool alive(pid_t pid) { return pid > 0 && kill(pid, 0) == 0; }

bool wait_gone(pid_t pid, std::chrono::seconds time) {
  const auto deadline = std::chrono::steady_clock::now() + time;
  while (alive(pid)) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return true;
}

}  // namespace

CommandResult run_command(const std::vector<std::string>& command) {
  int ends[2];
  if (pipe(ends) != 0) throw Error("cannot open a pipe");
  std::vector<char*> args;
  for (const auto& arg : command) args.push_back(const_cast<char*>(arg.c_str()));
  args.push_back(nullptr);
  const pid_t pid = fork();
  if (pid < 0) throw Error("cannot start " + command.front());
  if (pid == 0) {
    dup2(ends[1], STDOUT_FILENO);
    dup2(ends[1], STDERR_FILENO);
    close(ends[0]);
    close(ends[1]);
    execvp(args[0], args.data());
    _exit(127);
  }
  close(ends[1]);
  CommandResult result;
  char buffer[4096];
  for (ssize_t size; (size = read(ends[0], buffer, sizeof buffer)) > 0;)
    result.output.append(buffer, static_cast<std::size_t>(size));
  close(ends[0]);
  int status = 0;
  waitpid(pid, &status, 0);
  result.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return result;
}

std::string supervisor_config(const ProcessSet& set) {
  // A source is started when the stages are ready for its frames. It may come to its end: the last
  // scan, the one frame that was asked for.
  // Processes are looked at once a second. startsecs=0: a process that dies right after it was
  // restarted is no reason to give it up; start_script() lets it rest.
  std::string text = fmt::format(R"([unix_http_server]
file=%(here)s/{}
chmod=0700

[supervisord]
logfile=%(here)s/supervisord.log
logfile_maxbytes=1MB
logfile_backups=1
pidfile=%(here)s/supervisord.pid
childlogdir=%(here)s
identifier=weft-{}

[rpcinterface:supervisor]
supervisor.rpcinterface_factory=supervisor.rpcinterface:make_main_rpcinterface

[supervisorctl]
serverurl=unix://%(here)s/{}
)",
                                 kSocket, set.name, kSocket);
  int priority = 100;
  for (const auto& process : set.processes) {
    text += fmt::format(R"(
[program:{0}]
command=/bin/sh {0}.sh
directory=%(here)s
priority={1}
autostart={4}
autorestart={3}
startsecs=0
startretries=1000
stopsignal=INT
stopwaitsecs={2}
stopasgroup=true
killasgroup=true
redirect_stderr=true
stdout_logfile=%(here)s/{0}.log
stdout_logfile_maxbytes={5}
stdout_logfile_backups=2
)",
                        process.name, priority++, process.stop_wait_s,
                        process.source ? "unexpected" : "true", !process.source, set.log_bytes);
  }
  return text;
}

std::string start_script(const std::string& name, const std::vector<std::string>& command,
                         const fs::path& folder) {
  const auto starts = quoted(name + ".starts"), quick = quoted(name + ".quick");
  // .starts was written when the process before this one began.
  std::string text = fmt::format(R"(#!/bin/sh
# After two starts that lasted less than 3 s each comes a rest: 2 s, and twice that each time, 30 s at most.
quick=0
last=$(stat -c %Y {0} 2>/dev/null) && [ $(($(date +%s) - last)) -lt 3 ] && quick=$(($(cat {1} 2>/dev/null || echo 0) + 1))
echo $quick > {1}
if [ $quick -gt 2 ]; then
  rest=2 n=3
  while [ $n -lt $quick ] && [ $rest -lt 30 ]; do rest=$((rest * 2)) n=$((n + 1)); done
  [ $rest -le 30 ] || rest=30
  echo "weft: {2} ended soon after its start $quick times in a row; it starts again in $rest s"
  sleep $rest
fi
echo $$ >> {0}
cd {3}
exec)",
                                 starts, quick, name, quoted(folder.string()));
  for (const auto& arg : command) text += " " + quoted(arg);
  return text + "\n";
}

fs::path run_root() {
  if (const char* folder = std::getenv("WEFT_RUN_DIR"); folder && *folder)
    return fs::absolute(folder);
  if (const char* folder = std::getenv("XDG_RUNTIME_DIR"); folder && *folder)
    return fs::absolute(folder) / "weft";
  return fs::absolute("out/run");
}

RunFolder::RunFolder(fs::path folder) : folder_(std::move(folder)) {}

RunFolder RunFolder::find(const std::string& set_or_empty) {
  if (!set_or_empty.empty()) {
    std::string name = set_or_empty;
    if (fs::is_regular_file(name)) name = ProcessSet::from_file(name).name;
    RunFolder folder(run_root() / name);
    if (!fs::exists(folder.path() / "set.json"))
      throw Error("no set '" + name + "' is running (looked in " + run_root().string() +
                  "); start it with weft up SET.yaml");
    return folder;
  }
  std::vector<fs::path> found;
  std::string names;
  if (fs::is_directory(run_root())) {
    for (const auto& entry : fs::directory_iterator(run_root())) {
      if (!fs::exists(entry.path() / "set.json")) continue;
      found.push_back(entry.path());
      names += " " + entry.path().filename().string();
    }
  }
  if (found.empty())
    throw Error("no set is running (looked in " + run_root().string() +
                "); start one with weft up SET.yaml");
  if (found.size() > 1) throw Error("several sets are running, name one:" + names);
  return RunFolder(found.front());
}

void RunFolder::write(const ProcessSet& set, const std::string& url, bool lock_step) const {
  if ((folder_ / kSocket).string().size() >= sizeof(sockaddr_un::sun_path) - 20)
    throw Error(folder_.string() +
                ": too long a path for a socket; set WEFT_RUN_DIR to a folder with a short one");
  fs::create_directories(folder_);
  fs::permissions(folder_, fs::perms::owner_all);
  struct stat info {};
  if (stat(folder_.c_str(), &info) != 0 || info.st_uid != geteuid())
    throw Error(folder_.string() +
                ": belongs to somebody else; set WEFT_RUN_DIR to a folder of yours");
  nlohmann::json json{{"set", set.name}, {"file", set.file.string()}, {"url", url}};
  for (const auto& process : set.processes) {
    json["processes"].push_back(process.name);
    if (process.source) json["sources"].push_back(process.name);
    fs::remove(folder_ / (process.name + ".starts"));
    forget_quick_deaths(process.name);
    write_text_file(
        folder_ / (process.name + ".sh"),
        start_script(process.name, command_line(set, process, url, lock_step), fs::current_path()));
  }
  write_text_file(folder_ / kConfig, supervisor_config(set));
  write_text_file(folder_ / "set.json", json.dump(2) + "\n");
}

void RunFolder::forget_quick_deaths(const std::string& process) const {
  fs::remove(folder_ / (process + ".quick"));
}

void RunFolder::start_supervisor() const {
  const auto result = run_command({"supervisord", "-c", (folder_ / kConfig).string()});
  if (result.status == 127) throw Error("supervisord is not installed; apt-get install supervisor");
  if (result.status != 0)
    throw Error("supervisord did not start:\n" + result.output + "see " +
                (folder_ / "supervisord.log").string());
}

pid_t RunFolder::supervisor_pid() const {
  return std::atoi(read_text_file(folder_ / "supervisord.pid").c_str());
}

bool RunFolder::running() const { return alive(supervisor_pid()); }

std::string RunFolder::control(const std::vector<std::string>& args) const {
  std::vector<std::string> command{"supervisorctl", "-c", (folder_ / kConfig).string()};
  command.insert(command.end(), args.begin(), args.end());
  const auto result = run_command(command);
  // supervisorctl status exits with 3 when some process is not running.
  if (result.status != 0 && !(args.front() == "status" && result.status == 3))
    throw Error("supervisorctl " + args.front() + ": " + result.output);
  return result.output;
}

std::vector<RunFolder::Process> RunFolder::processes() const {
  std::vector<Process> processes;
  for (const auto& name : names()) {
    Process process{name, 0, 0};
    std::ifstream starts(folder_ / (name + ".starts"));
    for (pid_t pid = 0; starts >> pid; process.pid = pid) ++process.starts;
    if (!alive(process.pid)) process.pid = 0;
    processes.push_back(process);
  }
  return processes;
}

std::map<std::string, std::string> RunFolder::states() const {
  std::map<std::string, std::string> states;
  if (!running()) return states;
  std::istringstream lines(control({"status"}));
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string name, state;
    words >> name >> state;
    states[name] = state;
  }
  return states;
}

void RunFolder::stop() const {
  const pid_t supervisor = supervisor_pid();
  int longest = 10;
  if (alive(supervisor)) {
    std::istringstream config(read_text_file(folder_ / kConfig));
    for (std::string line; std::getline(config, line);) {
      if (line.starts_with("stopwaitsecs=")) longest += std::atoi(line.c_str() + 13);
    }
    kill(supervisor, SIGTERM);  // supervisord stops its processes, then itself
    if (!wait_gone(supervisor, std::chrono::seconds(longest)))
      throw Error("supervisord (process " + std::to_string(supervisor) + ") does not stop; see " +
                  (folder_ / "supervisord.log").string());
  }
  // Left over when the supervisor was killed: theirs are the last process numbers noted.
  for (const auto& process : processes()) {
    if (process.pid == 0) continue;
    const auto command = read_text_file("/proc/" + std::to_string(process.pid) + "/cmdline");
    if (command.find("--name" + std::string(1, '\0') + process.name + '\0') == std::string::npos)
      continue;
    kill(process.pid, SIGINT);
    if (!wait_gone(process.pid, std::chrono::seconds(5))) kill(process.pid, SIGKILL);
  }
  fs::remove(folder_ / kSocket);
  fs::remove(folder_ / "supervisord.pid");
  fs::remove(folder_ / "set.json");  // the logs stay
}

std::string RunFolder::url() const { return read_info(folder_).at("url"); }

fs::path RunFolder::set_file() const { return read_info(folder_).at("file").get<std::string>(); }

bool RunFolder::is_source(const std::string& process) const {
  const auto sources = read_info(folder_).value("sources", std::vector<std::string>{});
  return std::find(sources.begin(), sources.end(), process) != sources.end();
}

std::vector<std::string> RunFolder::names() const { return read_info(folder_).at("processes"); }

fs::path RunFolder::log(const std::string& process) const {
  std::string known;
  for (const auto& name : names()) {
    if (name == process) return folder_ / (process + ".log");
    known += " " + name;
  }
  throw Error("this host runs no process '" + process + "' of the set; it runs:" + known);
}

}  // namespace weft
