// The shipped sets under other circumstances: the same payloads all the same. More of them, and
// other builds, in determinism_slow_test.cpp.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <sstream>

#include "base/simd.hpp"
#include "base/text_file.hpp"
#include "integration/set_replay.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using test::Circumstances;

fs::path folder(const std::string& name) {
  return fs::temp_directory_path() / ("weft-same-" + std::to_string(getpid())) / name;
}

void expect_golden(const Circumstances& how) {
  const std::string set = "parts-sift";
  if (const auto why = test::why_not(set); !why.empty()) GTEST_SKIP() << why;
  std::vector<std::string> expected;
  std::istringstream golden(
      read_text_file(std::string(WEFT_SOURCE_DIR) + "/tests/integration/golden/parts-sift.txt"));
  for (std::string line; std::getline(golden, line);) {
    if (std::stoul(line) < how.frames) expected.push_back(line);
  }
  std::sort(expected.begin(), expected.end());
  EXPECT_EQ(test::replayed_payloads(set, how, folder("golden")), expected);
  if (!testing::Test::HasFailure()) fs::remove_all(folder("").parent_path());
}

TEST(Determinism, OneThreadAndStagesStartedLastToFirst) { expect_golden({3, 1, true, false, {}}); }

TEST(Determinism, TwoThreads) { expect_golden({3, 2, false, false, {}}); }

TEST(Determinism, EachStageKilledDuringTheReplay) { expect_golden({8, 2, false, true, {}}); }

/// Without it, the tests of narrow processors would prove nothing.
TEST(Determinism, TheEnvironmentNarrowsTheProcessor) {
#if !defined(__x86_64__)
  GTEST_SKIP() << "no x86-64";
#else
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma"))
    GTEST_SKIP() << "this processor has neither AVX2 nor FMA to do without";
  std::vector<std::string> narrow{"env"}, wide{WEFT_BINARY_DIR "/bin/weft-cpu-probe"};
  for (const auto& [name, value] : test::narrow_processor()) narrow.push_back(name + "=" + value);
  narrow.push_back(wide.front());
  const auto one = run_command(wide).output, other = run_command(narrow).output;
  EXPECT_NE(one.find(" simd avx2"), std::string::npos) << one;
  EXPECT_NE(other.find(" opencv 000 simd baseline"), std::string::npos) << other;
  EXPECT_NE(one.substr(0, one.find(" opencv")), other.substr(0, other.find(" opencv")))
      << "libm's last bits depend on the processor: " << one;
#endif
}

class ShippedSets : public testing::TestWithParam<std::string> {};

TEST_P(ShippedSets, OnANarrowProcessorWithTwoThreadsAndStartedLastToFirst) {
  const std::string set = GetParam();
  if (const auto why = test::why_not(set); !why.empty()) GTEST_SKIP() << why;
  Circumstances narrow{1, 2, true, false, test::narrow_processor()};
  if (!test::is_parts_pipeline(set)) narrow.environment = {{"WEFT_SIMD", "baseline"}};
  const auto plain = test::replayed_payloads(set, {1, 1, false, false, {}}, folder("plain"));
  EXPECT_EQ(test::replayed_payloads(set, narrow, folder("narrow")), plain);
  for (const auto& entry : fs::directory_iterator(folder("narrow"))) {
    if (entry.path().extension() != ".log") continue;
    EXPECT_NE(read_text_file(entry.path()).find(", SIMD baseline\n"), std::string::npos)
        << entry.path();
  }
  if (!HasFailure()) fs::remove_all(folder("").parent_path());
}

INSTANTIATE_TEST_SUITE_P(Determinism, ShippedSets, testing::ValuesIn(test::shipped_sets()),
                         [](const auto& set) {
                           std::string name = set.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace weft
