#include "tools/weft/run_folder.hpp"

#include <gtest/gtest.h>

#include <chrono>

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

}  // namespace
}  // namespace weft
