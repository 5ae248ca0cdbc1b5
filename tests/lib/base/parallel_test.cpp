#include "base/parallel.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "base/error.hpp"

namespace weft {
namespace {

TEST(ParallelFor, VisitsEveryIndexOnceForAnyThreadCount) {
  for (const int threads : {1, 2, 3, 8, 100}) {
    std::vector<int> visits(37, 0);
    parallel_for(37, threads, [&](int begin, int end) {
      for (int i = begin; i < end; ++i) ++visits[static_cast<std::size_t>(i)];
    });
    EXPECT_EQ(visits, std::vector<int>(37, 1));
  }
  parallel_for(0, 4, [](int, int) { FAIL(); });
}

TEST(ParallelFor, ThrowsTheFirstPiecesError) {
  try {
    parallel_for(4, 4, [](int begin, int) {
      if (begin > 0) throw Error("piece " + std::to_string(begin));
    });
    FAIL();
  } catch (const Error& e) {
    EXPECT_STREQ(e.what(), "piece 1");
  }
}

}  // namespace
}  // namespace weft
