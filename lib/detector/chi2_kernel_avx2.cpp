// Compiled with -mavx2 where the compiler knows it; nothing in here may run before the check below.
#include "detector/chi2_kernel.hpp"

#ifdef __AVX2__
namespace {
#include "detector/chi2_kernel.inc"
}
#endif

namespace weft::detector::chi2 {

Kernel avx2_kernel() {
#ifdef __AVX2__
  if (__builtin_cpu_supports("avx2")) return decide;
#endif
  return nullptr;
}

}  // namespace weft::detector::chi2
