// Every shipped set under one circumstance after the other, and with other builds.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <sstream>

#include "integration/set_replay.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using test::Circumstances;

constexpr std::size_t kFrames = 4;

class EveryShippedSet : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (const auto why = test::why_not(GetParam()); !why.empty()) GTEST_SKIP() << why;
  }
  void TearDown() override {
    if (!HasFailure()) fs::remove_all(folder_);
  }
  std::vector<std::string> replay(const std::string& name, const Circumstances& how) const {
    return test::replayed_payloads(GetParam(), how, folder_ / name);
  }
  const fs::path folder_ = fs::temp_directory_path() / ("weft-slow-" + std::to_string(getpid()));
};

TEST_P(EveryShippedSet, GivesTheSamePayloadsUnderEachCircumstance) {
  std::map<std::string, Circumstances> ways = {
      {"again", {kFrames, 0, false, false, {}}},
      {"one thread", {kFrames, 1, false, false, {}}},
      {"two threads", {kFrames, 2, false, false, {}}},
      {"started last to first", {kFrames, 0, true, false, {}}},
      {"baseline kernels", {kFrames, 0, false, false, {{"WEFT_SIMD", "baseline"}}}}};
  if (test::is_parts_pipeline(GetParam())) {
    for (const auto& each : test::narrow_processor())
      ways["only " + each.first] = {kFrames, 0, false, false, {each}};
    ways["narrow processor"] = {kFrames, 0, false, false, test::narrow_processor()};
    ways["each stage killed"] = {kFrames, 0, false, true, {}};
  }
  const auto plain = replay("plain", {kFrames, 0, false, false, {}});
  EXPECT_GT(plain.size(), 2 * kFrames);
  for (const auto& [name, how] : ways) EXPECT_EQ(replay(name, how), plain) << name;
}

/// WEFT_OTHER_BUILDS: build folders, with ':' between them, such as those of the release and the
/// asan preset.
TEST_P(EveryShippedSet, GivesTheSamePayloadsInOtherBuilds) {
  const char* const builds = std::getenv("WEFT_OTHER_BUILDS");
  if (!builds) GTEST_SKIP() << "WEFT_OTHER_BUILDS names no other build";
  const auto plain = replay("plain", {kFrames, 0, false, false, {}});
  std::istringstream list(builds);
  for (std::string build; std::getline(list, build, ':');) {
    const auto out = (folder_ / "other.lcm").string();
    const auto other =
        run_command({build + "/bin/weft", "replay", WEFT_SOURCE_DIR "/logs/sample.lcm", "--set",
                     test::set_file(GetParam()).string(), "--to-frame", std::to_string(kFrames - 1),
                     "--out", out});
    ASSERT_EQ(other.status, 0) << build << "\n" << other.output;
    EXPECT_EQ(test::sorted_payloads(out), plain) << build;
  }
}

INSTANTIATE_TEST_SUITE_P(Determinism, EveryShippedSet, testing::ValuesIn(test::shipped_sets()),
                         [](const auto& set) {
                           std::string name = set.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace weft
