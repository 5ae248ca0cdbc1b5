#include "tools/weft/run_folder.hpp"

#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <thread>

#include "support/files.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

TEST(StartScript, LetsAProcessRestThatEndsSoonAfterEachStart) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "a.sh", start_script("a", {"/bin/echo", "began", "it's"}, "/"));
  // However slow the machine is: the one before began an hour from now, or an hour ago.
  using Clock = fs::file_time_type::clock;
  const auto began_before = [&](Clock::duration ago) {
    fs::last_write_time(folder / "a.starts", Clock::now() - ago);
  };
  const auto start = [&] {
    const auto began = std::chrono::steady_clock::now();
    const auto result = run_command({"sh", "-c", "cd '" + folder.string() + "' && sh a.sh"});
    EXPECT_EQ(result.status, 0);
    return std::pair(result.output, std::chrono::steady_clock::now() - began);
  };
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(start().first, "began it's\n");
    began_before(-std::chrono::hours(1));
  }
  const auto [said, took] = start();
  EXPECT_EQ(said,
            "weft: a ended soon after its start 3 times in a row; it starts again in 2 s\n"
            "began it's\n");
  EXPECT_GE(took, std::chrono::seconds(2));
  // One that ran for a while ended for another reason.
  began_before(std::chrono::hours(1));
  EXPECT_EQ(start().first, "began it's\n");
  int starts = 0;
  for (const char c : test::read_bytes(folder / "a.starts")) starts += c == '\n';
  EXPECT_EQ(starts, 5);
}

TEST(RunFolder, KeepsTheLogsOfATalkativeProcessShort) {
  if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  const test::TemporaryFolder folder;
  const auto program = folder / "talk";
  test::write_bytes(program,
                    "#!/bin/sh\nline=$(printf %0999d 0)\n"
                    "i=0; while [ $i -lt 2000 ]; do echo $line >&2; i=$((i + 1)); done\n"
                    "echo the end >&2\nexec sleep 600\n");
  fs::permissions(program, fs::perms::owner_all);
  const auto set = ProcessSet::from_text(
      "log_bytes: 20000\nsources: [A]\nprocesses: [{name: talk, exec: ./talk}]\n",
      folder / "set.yaml");
  const RunFolder run(folder / "run");
  run.write(set, "udpm://239.255.76.67:7667?ttl=0", false);
  run.start_supervisor();
  const auto log = [&](const char* more) { return run.log("talk").string() + more; };
  // The last piece may be the one that the log is put aside for.
  const auto last_line = [&](const std::string& file) {
    return run_command({"tail", "-n", "1", file}).output;
  };
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (last_line(log("")) != "the end\n" && last_line(log(".1")) != "the end\n") {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_NE(run.processes().at(0).pid, 0);
  // supervisord looks at the size after each piece of 128 KiB at most.
  for (const char* more : {"", ".1", ".2"}) {
    ASSERT_TRUE(fs::exists(log(more))) << more;
    EXPECT_LE(fs::file_size(log(more)), 20'000u + 131'072u) << more;
  }
  EXPECT_GE(fs::file_size(log(".1")), 20'000u);
  EXPECT_FALSE(fs::exists(log(".3"))) << "2 MB were written";
  run.stop();
  EXPECT_FALSE(run.running());
}

TEST(RunFolder, KillsWhatDoesNotEndWhenAsked) {
  if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  const test::TemporaryFolder folder;
  const auto program = folder / "deaf";
  test::write_bytes(program, "#!/bin/sh\ntrap '' INT TERM\necho deaf\nexec sleep 600\n");
  fs::permissions(program, fs::perms::owner_all);
  const auto set = ProcessSet::from_text(
      "sources: [A]\nprocesses: [{name: deaf, exec: ./deaf, stop_wait_s: 1}]\n",
      folder / "set.yaml");
  const RunFolder run(folder / "run");
  run.write(set, "udpm://239.255.76.67:7667?ttl=0", false);
  run.start_supervisor();
  const auto log = run.log("deaf");
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!fs::exists(log) || test::read_bytes(log.string()) != "deaf\n") {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const auto process = run.processes().at(0);
  ASSERT_NE(process.pid, 0);
  run.stop();
  EXPECT_NE(kill(process.pid, 0), 0);
  EXPECT_FALSE(run.running());
}

}  // namespace
}  // namespace weft
