#pragma once

namespace weft {

/// Which code of a hot kernel runs. The bits are the same on every path; tests force each.
enum class SimdPath { kAuto, kBaseline, kAvx2 };

/// Whether this build and this processor have the path.
inline bool simd_path_available(SimdPath path) {
#if defined(__x86_64__)
  return path != SimdPath::kAvx2 || __builtin_cpu_supports("avx2");
#else
  return path != SimdPath::kAvx2;
#endif
}

/// What kAuto stands for in this process: the widest path there is, or the one that the environment
/// variable WEFT_SIMD names, "baseline" or "avx2", so that whole processes can be compared. Throws
/// Error when it names another, or one that this processor does not have.
SimdPath process_simd_path();
const char* to_string(SimdPath path);

/// kAuto becomes process_simd_path().
inline SimdPath resolve_simd_path(SimdPath path) {
  return path == SimdPath::kAuto ? process_simd_path() : path;
}

}  // namespace weft
