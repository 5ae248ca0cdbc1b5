#include "detector/chi2_kernel.hpp"

#include "base/simd.hpp"

namespace {
#include "detector/chi2_kernel.inc"
}

namespace weft::detector::chi2 {

void decide_baseline(const Model& model, const Histogram* histograms, std::int32_t count,
                     double* sums) {
  decide(model, histograms, count, sums);
}

Kernel best_kernel() {
  static const Kernel avx2 = avx2_kernel();
  return avx2 && process_simd_path() == SimdPath::kAvx2 ? avx2 : decide_baseline;
}

}  // namespace weft::detector::chi2
