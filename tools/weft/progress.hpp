#pragma once

#include <chrono>
#include <string>

namespace weft {

/// Done, total, rate and time left, on the standard error: one line that is rewritten on a
/// terminal, else a line every ten seconds.
class Progress {
 public:
  Progress(std::string what, long total);
  ~Progress();
  void update(long done, const std::string& note = "");
  void finish();

 private:
  void print(long done, const std::string& note, bool last);
  using Clock = std::chrono::steady_clock;
  std::string what_;
  long total_;
  long done_ = 0;
  bool terminal_;
  bool finished_ = false;
  Clock::time_point started_;
  Clock::time_point printed_;
};

}  // namespace weft
