#pragma once

#include <cstdint>

namespace weft::stage {

/// Microseconds since the epoch from a clock that never jumps: the wall clock at the first call
/// plus the monotonic clock since.
std::int64_t now_us();

/// Microseconds since the epoch by the host's own clock, which may be set at any time.
std::int64_t host_clock_us();

/// CPU time of this process, all threads, microseconds.
std::int64_t process_cpu_us();

}  // namespace weft::stage
