#include "tools/weft/pace.hpp"

#include <gtest/gtest.h>

#include <string>

#include "tools/weft/keys.hpp"
#include "tools/weft/session.hpp"

namespace weft {
namespace {

using std::chrono::milliseconds;

class PaceTest : public testing::Test {
 protected:
  /// Frames of 10 Hz that go within this time, asked for every millisecond.
  int sent_in(Pace& pace, int ms) {
    int sent = 0;
    for (const auto end = now_ + milliseconds(ms); now_ < end; now_ += milliseconds(1)) {
      if (!pace.may_send(utime_, now_)) continue;
      pace.sent(utime_, now_);
      utime_ += 100'000;
      ++sent;
    }
    return sent;
  }
  char next_key() {
    if (keys_.empty()) return ended_ ? Keys::kEnd : 0;
    const char key = keys_.front();
    keys_.erase(0, 1);
    return key;
  }
  std::function<char()> keyboard() {
    return [this] { return next_key(); };
  }
  Pace::Clock::time_point now_{std::chrono::hours(1)};
  std::int64_t utime_ = 1'700'000'000'000'000;
  std::string keys_;
  bool ended_ = false;
};

TEST_F(PaceTest, KeepsAMultipleOfTheRecordedSpeed) {
  Pace as_recorded(1, false, keyboard());
  EXPECT_EQ(sent_in(as_recorded, 1000), 10);
  Pace fast(4, false, keyboard());
  EXPECT_EQ(sent_in(fast, 1000), 40);
  Pace slow(0.5, false, keyboard());
  EXPECT_EQ(sent_in(slow, 1000), 5);
  Pace no_pace(0, false, keyboard());
  EXPECT_EQ(sent_in(no_pace, 50), 50);
}

TEST_F(PaceTest, PausesStepsAndGoesOn) {
  Pace pace(1, true, keyboard());
  EXPECT_EQ(sent_in(pace, 500), 0);
  keys_ = "s\n";
  EXPECT_EQ(sent_in(pace, 500), 2);
  EXPECT_TRUE(pace.paused());
  keys_ = " ";
  EXPECT_EQ(sent_in(pace, 1000), 10) << "the time of the pause is not made up for";
  keys_ = "+";
  EXPECT_NEAR(sent_in(pace, 1000), 20, 1);
  keys_ = "--";
  EXPECT_NEAR(sent_in(pace, 1000), 5, 1);
  EXPECT_EQ(pace.speed(), 0.5);
  keys_ = "q";
  EXPECT_THROW(sent_in(pace, 10), Interrupted);
}

TEST_F(PaceTest, GoesOnWhenTheKeysHaveEnded) {
  Pace pace(0, true, keyboard());
  keys_ = "\n\n";
  ended_ = true;
  EXPECT_EQ(sent_in(pace, 20), 20);
  EXPECT_FALSE(pace.paused());
}

}  // namespace
}  // namespace weft
