#include "stage/seq_set.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace weft::stage {
namespace {

TEST(SeqSet, EqualsASetOfNumbers) {
  std::mt19937 random(1);
  for (int round = 0; round < 50; ++round) {
    SeqSet set(1000);
    std::set<std::int64_t> oracle;
    for (int i = 0; i < 200; ++i) {
      const std::int64_t seq = random() % 150;
      set.insert(seq);
      oracle.insert(seq);
      EXPECT_EQ(set.missing(),
                *oracle.rbegin() - *oracle.begin() + 1 - static_cast<std::int64_t>(oracle.size()));
      const std::int64_t probe = random() % 160;
      EXPECT_EQ(set.contains(probe), oracle.contains(probe));
      std::int64_t absent = probe;
      while (oracle.contains(absent)) ++absent;
      EXPECT_EQ(set.next_absent(probe), absent);
    }
  }
}

TEST(SeqSet, IsBoundedAndStillCounts) {
  SeqSet set(4);
  for (std::int64_t seq = 0; seq < 1000; seq += 2) set.insert(seq);
  EXPECT_LE(set.intervals(), 4u);
  EXPECT_EQ(set.missing(), 499);
  EXPECT_TRUE(set.contains(1));     // given up
  EXPECT_FALSE(set.contains(997));  // still known to be missing
}

}  // namespace
}  // namespace weft::stage
