#include "integration/hosts.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <fstream>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/log.hpp"
#include "tools/weft/frame_name.hpp"

namespace weft::test_hosts {
namespace {

namespace fs = std::filesystem;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";

bool write_text(const char* path, const std::string& text) {
  std::ofstream out(path);
  return static_cast<bool>(out << text << std::flush);
}

/// Into namespaces of its own; the processes that it starts from here on have numbers of their own.
bool leave_the_world(std::string& why) {
  const int own = CLONE_NEWNET | CLONE_NEWUTS | CLONE_NEWNS | CLONE_NEWPID;
  const auto uid = geteuid(), gid = getegid();
  if (unshare(own) == 0) return true;
  if (unshare(CLONE_NEWUSER | own) != 0 || !write_text("/proc/self/setgroups", "deny") ||
      !write_text("/proc/self/uid_map", fmt::format("0 {} 1", uid)) ||
      !write_text("/proc/self/gid_map", fmt::format("0 {} 1", gid))) {
    why = "neither root nor a user namespace may make network namespaces here";
    return false;
  }
  return true;
}

/// In the child that leave_the_world() lets be born first.
bool furnish(std::string& why) {
  if (mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      mount("proc", "/proc", "proc", 0, nullptr) != 0) {
    why = "a world of its own may not mount /proc here";
    return false;
  }
  const auto result = run_command(
      {"sh", "-c",
       "ip link set lo up multicast on && ip link add switch type bridge mcast_snooping 0 && ip "
       "address add 10.9.0.254/24 dev switch && ip link set switch up && ip route add 224.0.0.0/4 "
       "dev switch"});
  why = "no bridge can be made here: " + result.output;
  return result.status == 0;
}

/// Runs body as the only child of the first process of a new world, which buries the dead.
int in_child(const std::function<int()>& body) {
  std::fflush(stdout);
  std::fflush(stderr);
  const pid_t outer = fork();
  if (outer < 0) throw Error("cannot fork");
  if (outer == 0) {
    std::string why;
    if (!leave_the_world(why)) {
      std::fprintf(stderr, "%s\n", why.c_str());
      _exit(90);
    }
    const pid_t first = fork();
    if (first == 0) {
      const pid_t second = fork();
      if (second == 0) {
        const int status = furnish(why) ? body() : 91;
        if (status == 91) std::fprintf(stderr, "%s\n", why.c_str());
        std::fflush(stdout);
        std::fflush(stderr);
        _exit(status);
      }
      int status = 0;
      for (pid_t dead; (dead = wait(&status)) > 0;)
        if (dead == second) _exit(WIFEXITED(status) ? WEXITSTATUS(status) : 92);
      _exit(93);
    }
    int status = 0;
    waitpid(first, &status, 0);
    _exit(WIFEXITED(status) ? WEXITSTATUS(status) : 94);
  }
  int status = 0;
  waitpid(outer, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 95;
}

struct Told {
  std::int8_t code = 0;
  std::vector<std::uint8_t> data;
};
/// Every answer of a log, by channel and frame, in order.
using Answers = std::map<std::string, std::map<FrameName, std::vector<Told>>>;
Answers read_answers(const fs::path& file) {
  Answers answers;
  stage::LogReader log(file.string());
  for (stage::LogEvent event; log.next(event);) {
    if (event.channel.starts_with("STAGE_") || event.channel == "LCM_SELF_TEST") continue;
    const auto header = read_frame_header(event.data);
    if (!header) continue;
    answers[event.channel][header->frame].push_back({header->status_code, std::move(event.data)});
  }
  return answers;
}

bool good(const Told& told) { return told.code == 0 || told.code == 1; }

}  // namespace

std::string why_no_hosts() {
  static const std::string why = [] {
    if (run_command({"ip", "-V"}).status != 0) return std::string("no program ip (iproute2)");
    const int status = in_child([] { return 0; });
    return status == 0 ? std::string()
                       : "no network namespaces joined by a bridge are permitted here (status " +
                             std::to_string(status) + ")";
  }();
  return why;
}

void in_a_world_of_its_own(const std::function<void()>& body) {
  const int status = in_child([&] {
    try {
      body();
    } catch (const std::exception& e) {
      ADD_FAILURE() << e.what();
    }
    return testing::Test::HasFailure() ? 1 : 0;
  });
  EXPECT_EQ(status, 0) << "see above";
}

Lan::Lan(const std::vector<std::string>& names, fs::path folder) : folder_(std::move(folder)) {
  int number = 0;
  for (const auto& name : names) {
    ++number;
    // Its first process lives until the cable is plugged in; the descriptors keep the host.
    int ready[2], done[2];
    if (pipe(ready) != 0 || pipe(done) != 0) throw Error("cannot make a pipe");
    const pid_t pid = fork();
    if (pid == 0) {
      char byte = 0;
      const bool made =
          unshare(CLONE_NEWNET | CLONE_NEWUTS) == 0 && sethostname(name.c_str(), name.size()) == 0;
      close(done[1]);
      if (!made || write(ready[1], "x", 1) != 1 || read(done[0], &byte, 1) < 0) _exit(1);
      _exit(0);
    }
    close(ready[1]);
    close(done[0]);
    char byte = 0;
    const bool made = read(ready[0], &byte, 1) == 1;
    Host host;
    const auto proc = "/proc/" + std::to_string(pid) + "/ns/";
    host.network = open((proc + "net").c_str(), O_RDONLY | O_CLOEXEC);
    host.name = open((proc + "uts").c_str(), O_RDONLY | O_CLOEXEC);
    host.address = "10.9.0." + std::to_string(number);
    if (!made || host.network < 0 || host.name < 0) throw Error("host " + name + " cannot be made");
    const auto cable = "cable" + std::to_string(number);
    const auto plug = run_command(
        {"sh", "-c",
         fmt::format("ip link add {0} type veth peer name eth0 netns {1} && ip link set {0} master "
                     "switch up mtu 1500",
                     cable, pid)});
    hosts_[name] = host;
    close(done[1]);
    close(ready[0]);
    waitpid(pid, nullptr, 0);
    const auto set_up = run(
        name, {"sh", "-c",
               fmt::format("ip link set lo up && ip address add {}/24 dev eth0 && ip link set eth0 "
                           "up mtu 1500 && ip route add 224.0.0.0/4 dev eth0",
                           host.address)});
    if (plug.status != 0 || set_up.status != 0)
      throw Error("host " + name + " has no network: " + plug.output + set_up.output);
  }
}

void Lan::enter(const std::string& host) const {
  if (host.empty()) return;
  const auto& where = hosts_.at(host);
  if (setns(where.network, CLONE_NEWNET) != 0 || setns(where.name, CLONE_NEWUTS) != 0) _exit(126);
}

pid_t Lan::start(const std::string& host, const std::vector<std::string>& command,
                 const fs::path& output) const {
  std::vector<char*> args;
  for (const auto& arg : command) args.push_back(const_cast<char*>(arg.c_str()));
  args.push_back(nullptr);
  const auto run_dir = (folder_ / (host.empty() ? "switch" : host)).string();
  const pid_t pid = fork();
  if (pid < 0) throw Error("cannot fork");
  if (pid == 0) {
    enter(host);
    setenv("WEFT_RUN_DIR", run_dir.c_str(), 1);
    const int file = open(output.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
    dup2(file, STDOUT_FILENO);
    dup2(file, STDERR_FILENO);
    execvp(args[0], args.data());
    _exit(127);
  }
  return pid;
}

CommandResult Lan::run(const std::string& host, const std::vector<std::string>& command) const {
  const auto file = folder_ / fmt::format("output-{}", getpid());
  fs::remove(file);
  int status = 0;
  waitpid(start(host, command, file), &status, 0);
  CommandResult result;
  result.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  result.output = read_text_file(file);
  return result;
}

CommandResult Lan::weft(const std::string& host, std::vector<std::string> args) const {
  args.insert(args.begin(), kWeft);
  return run(host, args);
}

void Lan::lose(const std::string& host, int per_thousand) const {
  // Before fragments are put together (priority -400); the host's own messages come back to it over
  // the same interface and are spared.
  auto rules = std::string("table ip loss\ndelete table ip loss\n");
  if (per_thousand > 0)
    rules += fmt::format(
        "table ip loss {{\nchain in {{\ntype filter hook prerouting priority -450;\nip saddr != {} "
        "ip daddr 224.0.0.0/4 numgen random mod 1000 < {} counter drop\n}}\n}}\n",
        hosts_.at(host).address, per_thousand);
  const auto file = folder_ / "loss.nft";
  write_text_file(file, rules);
  const auto result = run(host, {"nft", "-f", file.string()});
  if (result.status != 0) throw Error("nft: " + result.output);
}

std::int64_t Lan::lost_packets(const std::string& host) const {
  const auto text = run(host, {"nft", "list", "table", "ip", "loss"}).output;
  const auto at = text.find("counter packets ");
  return at == std::string::npos ? 0 : std::atoll(text.c_str() + at + 16);
}

int stop_process(pid_t pid) {
  kill(pid, SIGINT);
  int status = 0;
  waitpid(pid, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

Verdict judge(const fs::path& recorded, const fs::path& set, const fs::path& work) {
  const auto expected_log = work / "expected.lcm";
  const auto replayed = run_command(
      {kWeft, "replay", recorded.string(), "--set", set.string(), "--out", expected_log.string()});
  if (replayed.status != 0) throw Error("the lock-step replay failed: " + replayed.output);
  const auto expected = read_answers(expected_log);
  const auto told = read_answers(recorded);
  const auto sources = ProcessSet::from_file(set).sources;
  Verdict verdict;
  const auto fault = [&](const std::string& channel, const FrameName& frame, const char* what) {
    if (verdict.faults.size() < 5)
      verdict.faults.push_back(channel + " of " + to_string(frame) + ": " + what);
  };
  for (const auto& [channel, frames] : expected) {
    if (std::find(sources.begin(), sources.end(), channel) != sources.end()) {
      verdict.frames = static_cast<int>(frames.size());
      continue;
    }
    auto& counts = verdict.channels[channel];
    const auto of_channel = told.find(channel);
    if (of_channel == told.end()) continue;
    for (const auto& [frame, answers] : of_channel->second) {
      const auto right = frames.find(frame);
      if (right == frames.end()) {
        ++counts.wrong;
        fault(channel, frame, "answers a frame that was never sent");
        continue;
      }
      ++counts.answered;
      ++counts.codes[answers.front().code];
      counts.good += good(answers.front());
      // The same process answers the same again; one that was killed knows nothing of its answers.
      for (const auto& answer : answers) {
        if (good(answer) && answer.data != right->second.front().data) {
          ++counts.wrong;
          fault(channel, frame, "other bytes than in lock-step");
        }
        if (good(answers.front()) && !good(answer)) {
          ++counts.changed;
          fault(channel, frame, "taken back");
        }
      }
    }
  }
  return verdict;
}

nlohmann::json all_processes(const nlohmann::json& status) {
  nlohmann::json all = nlohmann::json::object();
  for (const char* group : {"processes", "elsewhere"}) {
    if (!status.contains(group)) continue;
    for (const auto& [name, process] : status[group].items()) all[name] = process;
  }
  return all;
}

}  // namespace weft::test_hosts
