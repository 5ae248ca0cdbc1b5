#include "base/simd.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "base/error.hpp"

namespace weft {
namespace {

/// In a process of its own: the answer is for life.
[[noreturn]] void resolve_with(const char* name) {
  setenv("WEFT_SIMD", name, 1);
  try {
    std::fprintf(stderr, "auto is %s, avx2 is %s\n", to_string(resolve_simd_path(SimdPath::kAuto)),
                 to_string(resolve_simd_path(SimdPath::kAvx2)));
  } catch (const Error& e) {
    std::fprintf(stderr, "%s\n", e.what());
    std::exit(1);
  }
  std::exit(0);
}

TEST(SimdPath, TheEnvironmentForcesAWholeProcess) {
  using testing::ExitedWithCode;
  const bool avx2 = simd_path_available(SimdPath::kAvx2);
  EXPECT_EXIT(resolve_with("baseline"), ExitedWithCode(0), "auto is baseline, avx2 is avx2");
  EXPECT_EXIT(resolve_with(""), ExitedWithCode(0), avx2 ? "auto is avx2" : "auto is baseline");
  EXPECT_EXIT(resolve_with("avx2"), ExitedWithCode(avx2 ? 0 : 1),
              avx2 ? "auto is avx2" : "does not have it; use baseline");
  EXPECT_EXIT(resolve_with("sse9"), ExitedWithCode(1), "WEFT_SIMD=sse9: expected baseline or avx2");
}

}  // namespace
}  // namespace weft
