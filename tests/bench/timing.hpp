#pragma once

#include <malloc.h>

#include <algorithm>
#include <ctime>
#include <functional>
#include <limits>

namespace weft::bench {

/// Keeps freed memory for the next run, ours and the peer's alike: what a virtual machine takes for
/// fresh pages can be most of the time of a peer that allocates much.
inline void keep_memory() {
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, 2147483647);
}

/// With one thread the CPU time of the process: on a machine that others use too, waiting is not
/// part of the work. With more, what passes on the clock.
inline double ms_of(int threads, const std::function<void()>& body) {
  const auto now = [threads] {
    timespec time;
    clock_gettime(threads == 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC, &time);
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
  };
  const double start = now();
  body();
  return now() - start;
}

/// The fastest of several runs.
inline double best_ms(int runs, int threads, const std::function<void()>& body) {
  double best = std::numeric_limits<double>::infinity();
  for (int run = 0; run < runs; ++run) best = std::min(best, ms_of(threads, body));
  return best;
}

}  // namespace weft::bench
