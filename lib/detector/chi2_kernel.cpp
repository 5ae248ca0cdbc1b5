#include "detector/chi2_kernel.hpp"

namespace {
#include "detector/chi2_kernel.inc"
}

namespace weft::detector::chi2 {

void decide_baseline(const Model& model, const Histogram* histograms, std::int32_t count,
                     double* sums) {
  decide(model, histograms, count, sums);
}

Kernel best_kernel() {
  static const Kernel kernel = avx2_kernel() ? avx2_kernel() : decide_baseline;
  return kernel;
}

}  // namespace weft::detector::chi2
