#include "integration/set_replay.hpp"

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <set>

#include "base/error.hpp"
#include "stage/log.hpp"
#include "stage/net_namespace.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/run_folder.hpp"
#include "tools/weft/session.hpp"

namespace weft::test {
namespace {

namespace fs = std::filesystem;

const std::string kSource = WEFT_SOURCE_DIR;
const std::string kLog = kSource + "/logs/sample.lcm";

bool has_threads(const ProcessSet& set, const ProcessSpec& process) {
  const auto printed = run_command({find_program(set, process).string(), "--print-settings"});
  if (printed.status != 0) throw Error(printed.output);
  return ("\n" + printed.output).find("\nthreads:") != std::string::npos;
}

void play(ProcessSet set, const Circumstances& how, const fs::path& folder) {
  std::erase_if(set.processes, [](const ProcessSpec& process) { return process.source; });
  std::vector<std::string> names;
  for (auto& process : set.processes) {
    names.push_back(process.name);
    if (how.threads > 0 && has_threads(set, process))
      process.with.push_back("threads=" + std::to_string(how.threads));
  }
  for (const auto& [name, value] : how.environment) setenv(name.c_str(), value.c_str(), 1);
  if (how.reversed) std::reverse(set.processes.begin(), set.processes.end());
  SourceLog source(kLog, set.sources);
  Session session(set, Transport::kPrivateNetwork, {}, folder.string(), {});
  session.player().wait_ready();
  stage::LogWriter out((folder / "out.lcm").string());
  std::string unanswered;
  session.player().play(
      how.frames, [&](std::size_t index) { return source.read(index); },
      [&](PlayedFrame&& frame) {
        for (const auto& channel : frame.unanswered) unanswered += " " + channel;
        for (const auto& event : frame.source.events) out.write(0, event.channel, event.data);
        for (const auto& each : frame.outputs) out.write(0, each.channel, each.data);
        if (how.kill) kill(session.children().pid(names[frame.index % names.size()]), SIGKILL);
      });
  out.close();
  if (!unanswered.empty()) throw Error("no answer on" + unanswered);
  if (!session.player().inconsistencies().empty())
    throw Error(session.player().inconsistencies().front());
  if (how.kill && session.player().restarts() < static_cast<int>(how.frames) / 2)
    throw Error("the stages were not killed");
}

}  // namespace

std::map<std::string, std::string> narrow_processor() {
  return {{"WEFT_SIMD", "baseline"},
          {"GLIBC_TUNABLES",
           "glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX512BW,-AVX2,-AVX,-FMA,-FMA4,-BMI2,-SSE4_2,"
           "-SSE4_1,-SSSE3"},
          {"OPENCV_CPU_DISABLE", "AVX512-SKX,AVX2,AVX,FP16,SSE4.2,SSE4.1"},
          {"OPENBLAS_CORETYPE", "Prescott"}};
}

std::vector<std::string> shipped_sets() {
  std::vector<std::string> sets;
  for (const auto& entry : fs::directory_iterator(kSource + "/config/sets")) {
    if (entry.path().extension() == ".yaml") sets.push_back(entry.path().stem().string());
  }
  std::sort(sets.begin(), sets.end());
  return sets;
}

fs::path set_file(const std::string& set) { return kSource + "/config/sets/" + set + ".yaml"; }

std::string why_not(const std::string& set) {
  const pid_t pid = fork();
  if (pid == 0) {
    std::string why;
    _exit(stage::enter_private_network(why) ? 0 : 1);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  if (status != 0) return "no network namespace is permitted here";
  const auto sources = ProcessSet::from_file(set_file(set)).sources;
  return sources == std::vector<std::string>{"RGBD_FRAME"}
             ? ""
             : "logs/sample.lcm does not hold the sources of " + set;
}

bool is_parts_pipeline(const std::string& set) {
  static const std::set<std::string> stages = {"weft-capture", "weft-foreground", "weft-describe",
                                               "weft-prior",   "weft-score",      "weft-refine",
                                               "weft-grasp"};
  const auto processes = ProcessSet::from_file(set_file(set)).processes;
  return std::all_of(processes.begin(), processes.end(),
                     [](const ProcessSpec& each) { return stages.contains(each.exec); });
}

std::vector<std::string> sorted_payloads(const fs::path& log) {
  auto hashes = payload_hashes(log.string());
  std::sort(hashes.begin(), hashes.end());
  return hashes;
}

std::vector<std::string> replayed_payloads(const std::string& set, const Circumstances& how,
                                           const fs::path& folder) {
  fs::create_directories(folder);
  // In a child process: a namespace is for life, and so is what the environment decides.
  const pid_t pid = fork();
  if (pid == 0) {
    std::string problem;
    try {
      if (stage::enter_private_network(problem)) {
        problem.clear();
        play(ProcessSet::from_file(set_file(set)), how, folder);
      }
    } catch (const std::exception& e) {
      problem = e.what();
    }
    std::fprintf(stderr, "%s%s", problem.c_str(), problem.empty() ? "" : "\n");
    _exit(problem.empty() ? 0 : 1);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  if (status != 0) throw Error("the replay of " + set + " failed; see " + folder.string());
  return sorted_payloads(folder / "out.lcm");
}

}  // namespace weft::test
