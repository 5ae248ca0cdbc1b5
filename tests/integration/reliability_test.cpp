// What goes wrong on a robot: processes die or hang, messages are garbage, disks are full.
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <thread>

#include "base/text_file.hpp"
#include "integration/hosts.hpp"
#include "integration/scenarios.hpp"
#include "integration/test_log.hpp"

namespace weft::test_hosts {
namespace {

namespace fs = std::filesystem;

class Reliability : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_hosts(); !why.empty()) GTEST_SKIP() << why;
    if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  }
};

TEST_F(Reliability, KilledProcessesComeBackAndNoAnswerIsWrong) {
  kill_in_turn(small_set("rate_hz: 10"), 1, 15);
}

TEST_F(Reliability, AStageThatHangsForAWhileCatchesUp) { stop_and_go(3); }

TEST_F(Reliability, GarbageIsCountedAndNothingElse) {
  garbage(small_set("trigger: message"), test_stage::test_event(0, 5000).data, 300);
}

TEST_F(Reliability, ASmallSoakNeitherGrowsNorSlows) {
  std::vector<std::vector<std::uint8_t>> messages;
  for (int i = 0; i < 10; ++i) messages.push_back(test_stage::test_event(i, 5000).data);
  soak(small_set(""), messages, 1200);
}

TEST_F(Reliability, AFullDiskEndsARecordingAtOnceAndLeavesItReadable) {
  const auto folder = fs::temp_directory_path() / ("weft-disk-" + std::to_string(getpid()));
  fs::create_directories(folder / "disk");
  write_text_file(folder / "set.yaml", small_set("rate_hz: 20, with: {bytes: 50000}"));
  in_a_world_of_its_own([&] {
    ASSERT_EQ(mount("disk", (folder / "disk").c_str(), "tmpfs", 0, "size=2m"), 0);
    const Lan lan({}, folder);
    const auto up = lan.weft("", {"up", (folder / "set.yaml").string()});
    ASSERT_EQ(up.status, 0) << up.output;
    const auto log = (folder / "disk" / "run.lcm").string();
    const auto began = std::chrono::steady_clock::now();
    const auto record =
        lan.weft("", {"record", log, "--set", (folder / "set.yaml").string(), "--duration", "60"});
    EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(50));
    EXPECT_EQ(record.status, 1) << record.output;
    EXPECT_NE(record.output.find("No space left on device"), std::string::npos) << record.output;
    const auto check = lan.weft("", {"log", "check", log});
    EXPECT_EQ(check.status, 0) << check.output;
    EXPECT_GT(fs::file_size(log), 1'800'000u) << "as much as the disk holds";
    EXPECT_EQ(lan.weft("", {"record", log, "--duration", "1"}).status, 1) << "replaced a log";
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);
  });
  if (!HasFailure()) fs::remove_all(folder);
}

}  // namespace
}  // namespace weft::test_hosts
