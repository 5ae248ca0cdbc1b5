#include "tools/weft/pace.hpp"

#include <algorithm>

#include "tools/weft/keys.hpp"
#include "tools/weft/session.hpp"

namespace weft {

Pace::Pace(double speed, bool step, std::function<char()> next_key)
    : speed_(speed), paused_(step), next_key_(std::move(next_key)) {}

void Pace::take_keys() {
  for (char key = next_key_(); key != 0; key = next_key_()) {
    if (key == Keys::kEnd) {
      paused_ = paused_ && steps_ > 0;
      return;
    }
    if (key == 'q') throw Interrupted{};
    if (key == ' ') paused_ = !paused_;
    if (key == 's' || key == '\n') {
      paused_ = true;
      ++steps_;
    }
    if (key == '+') speed_ = std::min(1024.0, (speed_ == 0 ? 1 : speed_) * 2);
    if (key == '-') speed_ = std::max(1.0 / 1024, (speed_ == 0 ? 1 : speed_) / 2);
  }
}

bool Pace::may_send(std::int64_t utime, Clock::time_point now) {
  take_keys();
  if (steps_ > 0) return true;
  if (paused_) {
    last_.reset();  // the time of the pause is not made up for
    return false;
  }
  if (!last_ || speed_ == 0) return true;
  const auto apart = std::max<std::int64_t>(0, utime - last_->first);
  return now >= last_->second + std::chrono::microseconds(
                                    static_cast<std::int64_t>(static_cast<double>(apart) / speed_));
}

void Pace::sent(std::int64_t utime, Clock::time_point now) {
  if (steps_ > 0) --steps_;
  last_ = {utime, now};
}

}  // namespace weft
