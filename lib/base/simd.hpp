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

/// kAuto becomes the widest path there is.
inline SimdPath resolve_simd_path(SimdPath path) {
  if (path != SimdPath::kAuto) return path;
  return simd_path_available(SimdPath::kAvx2) ? SimdPath::kAvx2 : SimdPath::kBaseline;
}

}  // namespace weft
