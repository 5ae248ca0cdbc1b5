// The shipped set under other circumstances: the golden payloads of golden_test.cpp all the same.
// Forced SIMD paths are tested where they are, in tests/lib.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <sstream>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/log.hpp"
#include "stage/net_namespace.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/session.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

const std::string kSource = WEFT_SOURCE_DIR;
constexpr int kNoNetwork = 3;

struct Circumstances {
  int threads = 1;
  bool reversed = false;  // the stages are started last to first
  bool kill = false;      // each stage in turn, one after each frame
  std::size_t frames = 3;
};

/// In a child process: a namespace is for life.
int play(const Circumstances& how, const fs::path& folder) {
  std::string why;
  if (!stage::enter_private_network(why)) return kNoNetwork;
  auto set = ProcessSet::from_file(kSource + "/config/sets/parts-sift.yaml");
  std::vector<std::string> names;
  for (auto& process : set.processes) {
    names.push_back(process.name);
    if (process.name == "describe-sift" || process.name == "score" || process.name == "refine")
      process.with.push_back("threads=" + std::to_string(how.threads));
  }
  if (how.reversed) std::reverse(set.processes.begin(), set.processes.end());
  SourceLog source(kSource + "/logs/sample.lcm", set.sources);
  Session session(set, Transport::kPrivateNetwork, {}, (folder / "logs").string(), {});
  session.player().wait_ready();
  stage::LogWriter out((folder / "out.lcm").string());
  bool all = true;
  session.player().play(
      how.frames, [&](std::size_t index) { return source.read(index); },
      [&](PlayedFrame&& frame) {
        all = all && frame.unanswered.empty();
        for (const auto& event : frame.source.events) out.write(0, event.channel, event.data);
        for (const auto& each : frame.outputs) out.write(0, each.channel, each.data);
        if (how.kill) kill(session.children().pid(names[frame.index % names.size()]), SIGKILL);
      });
  out.close();
  const bool killed = !how.kill || session.player().restarts() >= 3;
  return all && killed && session.player().inconsistencies().empty() ? 0 : 1;
}

void expect_golden(const Circumstances& how) {
  const auto folder = fs::temp_directory_path() / ("weft-same-" + std::to_string(getpid()));
  fs::create_directories(folder);
  const pid_t pid = fork();
  if (pid == 0) {
    int status = 1;
    try {
      status = play(how, folder);
    } catch (const Error& e) {
      std::fprintf(stderr, "%s\n", e.what());
    }
    _exit(status);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNoNetwork)
    GTEST_SKIP() << "no network namespace is permitted here";
  ASSERT_EQ(status, 0);
  std::vector<std::string> expected;
  std::istringstream golden(read_text_file(kSource + "/tests/integration/golden/parts-sift.txt"));
  for (std::string line; std::getline(golden, line);) {
    if (std::stoul(line) < how.frames) expected.push_back(line);
  }
  auto hashes = payload_hashes((folder / "out.lcm").string());
  std::sort(expected.begin(), expected.end());
  std::sort(hashes.begin(), hashes.end());
  EXPECT_EQ(hashes, expected);
  if (!testing::Test::HasFailure()) fs::remove_all(folder);
}

TEST(Determinism, OneThreadAndStagesStartedLastToFirst) { expect_golden({1, true, false, 3}); }

TEST(Determinism, TwoThreads) { expect_golden({2, false, false, 3}); }

TEST(Determinism, EachStageKilledDuringTheReplay) { expect_golden({2, false, true, 8}); }

}  // namespace
}  // namespace weft
