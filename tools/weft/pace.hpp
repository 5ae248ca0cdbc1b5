#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>

namespace weft {

/// When the next frame of a replay may go: at a multiple of the recorded speed, one by one, or not
/// while it is paused. Keys: space pauses and goes on, s or Enter plays one frame, + and - double
/// and halve the speed, q ends. When the keys have ended, a replay that was stepped goes on by
/// itself.
class Pace {
 public:
  using Clock = std::chrono::steady_clock;
  /// speed: 1 as recorded, 0 as fast as the stages answer. next_key: of Keys.
  Pace(double speed, bool step, std::function<char()> next_key);
  /// Whether the frame of this time may be sent now. Throws Interrupted on q.
  bool may_send(std::int64_t utime, Clock::time_point now);
  /// It was sent; the next one waits for its own time, or for a key.
  void sent(std::int64_t utime, Clock::time_point now);
  bool paused() const { return paused_; }
  double speed() const { return speed_; }

 private:
  void take_keys();
  double speed_;
  bool paused_;
  int steps_ = 0;
  std::function<char()> next_key_;
  std::optional<std::pair<std::int64_t, Clock::time_point>> last_;  // utime and when it was due
};

}  // namespace weft
