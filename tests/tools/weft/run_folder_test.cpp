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

/// A set of one process, a shell script, under a supervisord of its own.
class SupervisedScript : public testing::Test {
 protected:
  void SetUp() override {
    if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  }
  void TearDown() override {
    if (started_ && run_.running()) run_.stop();
  }
  /// set, process: keys of the set and of its process.
  void start(const std::string& script, const std::string& set, const std::string& process) {
    test::write_bytes(folder_ / "script", "#!/bin/sh\n" + script);
    fs::permissions(folder_ / "script", fs::perms::owner_all);
    run_.write(ProcessSet::from_text(set +
                                         "sources: [A]\nprocesses: [{name: script, exec: "
                                         "./script" +
                                         process + "}]\n",
                                     folder_ / "set.yaml"),
               "udpm://239.255.76.67:7667?ttl=0", false);
    run_.start_supervisor();
    started_ = true;
  }
  /// more: ".1" is the log that was put aside last.
  std::string log(const std::string& more = "") const { return run_.log("script").string() + more; }
  bool last_line_is(const std::string& line, const std::string& more = "") const {
    return run_command({"tail", "-n", "1", log(more)}).output == line + "\n";
  }
  template <class Condition>
  static bool wait_for(const Condition& condition) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
    while (!condition() && std::chrono::steady_clock::now() < deadline)
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return condition();
  }

  const test::TemporaryFolder folder_;
  const RunFolder run_{folder_ / "run"};
  bool started_ = false;
};

TEST_F(SupervisedScript, WritesLogsOfABoundedSize) {
  start(
      "line=$(printf %0999d 0)\n"
      "i=0; while [ $i -lt 2000 ]; do echo $line >&2; i=$((i + 1)); done\n"
      "echo the end >&2\nexec sleep 600\n",
      "log_bytes: 20000\n", "");
  // The last piece may be the one that the log is put aside for.
  ASSERT_TRUE(wait_for([&] { return last_line_is("the end") || last_line_is("the end", ".1"); }));
  EXPECT_NE(run_.processes().at(0).pid, 0);
  // supervisord looks at the size after each piece of 128 KiB at most.
  for (const char* more : {"", ".1", ".2"}) {
    ASSERT_TRUE(fs::exists(log(more))) << more;
    EXPECT_LE(fs::file_size(log(more)), 20'000u + 131'072u) << more;
  }
  EXPECT_GE(fs::file_size(log(".1")), 20'000u);
  EXPECT_FALSE(fs::exists(log(".3"))) << "2 MB were written";
  run_.stop();
  EXPECT_FALSE(run_.running());
}

TEST_F(SupervisedScript, IsKilledWhenItDoesNotEndAsAsked) {
  start("trap '' INT TERM\necho deaf\nexec sleep 600\n", "", ", stop_wait_s: 1");
  ASSERT_TRUE(wait_for([&] { return last_line_is("deaf"); }));
  const auto pid = run_.processes().at(0).pid;
  ASSERT_NE(pid, 0);
  run_.stop();
  EXPECT_NE(kill(pid, 0), 0);
  EXPECT_FALSE(run_.running());
}

}  // namespace
}  // namespace weft
