#include "stage/clock.hpp"

#include <chrono>
#include <ctime>

namespace weft::stage {

std::int64_t now_us() {
  using std::chrono::duration_cast;
  using std::chrono::microseconds;
  const auto steady_us = [] {
    return duration_cast<microseconds>(std::chrono::steady_clock::now().time_since_epoch()).count();
  };
  static const std::int64_t offset_us =
      duration_cast<microseconds>(std::chrono::system_clock::now().time_since_epoch()).count() -
      steady_us();
  return steady_us() + offset_us;
}

std::int64_t host_clock_us() {
  using std::chrono::duration_cast;
  return duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

std::int64_t process_cpu_us() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return std::int64_t{time.tv_sec} * 1'000'000 + time.tv_nsec / 1000;
}

}  // namespace weft::stage
