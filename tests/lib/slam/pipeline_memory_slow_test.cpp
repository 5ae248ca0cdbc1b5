#include <gtest/gtest.h>
#include <time.h>

#include <cstdio>

#include "looping_run.hpp"

namespace weft::slam {
namespace {

double cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

TEST(PipelineMemory, IsBoundedOverTenThousandFramesOfALoop) {
  test::LoopingRun run;
  std::vector<test::LoopState> turns;
  for (int turn = 0; turn < 50; ++turn) {
    const double before = cpu_s();
    turns.push_back(run.turn());
    const auto& now = turns.back();
    std::printf(
        "%5ld frames: %zu key frames of %d asked, %zu points, %zu planes, %.1f MB; %d lost, "
        "worst %.3f m; %.0f frames/s of CPU\n",
        static_cast<long>(now.frames), now.key_frames, now.asked, now.points, now.planes,
        now.resident_mb, now.lost, now.worst_m, test::LoopingRun::kTurn / (cpu_s() - before));
    std::fflush(stdout);
    EXPECT_EQ(now.lost, 0) << turn;
    EXPECT_LT(now.worst_m, 0.02) << turn;
  }
  const auto &early = turns[9], &late = turns.back();
  ASSERT_EQ(late.frames, 10000);
  EXPECT_LE(late.key_frames, early.key_frames + 5);
  EXPECT_LE(late.points, early.points + early.points / 5);
  EXPECT_LE(late.planes, early.planes + 2);
  // The path is kept, some 160 bytes a frame; nothing else grows.
  EXPECT_LT(late.resident_mb, early.resident_mb + 3.0);
}

}  // namespace
}  // namespace weft::slam
