#pragma once

#include <cstdint>

/// Decision sums of a chi-squared SVM, sum_i a_i exp(-gamma D(x, t_i)), for many histograms x at
/// once. Support vectors lie in lanes, words are added one after the other, so every instruction
/// set gives the same bits.
namespace weft::detector::chi2 {

/// Support vectors of one block; a model is padded to whole blocks with coefficient 0.
inline constexpr int kBlock = 32;

/// A non-zero entry of a histogram.
struct Entry {
  std::int32_t word;
  float share;
};

struct Histogram {
  const Entry* entries;
  std::int32_t count;
  float sum;  // of all shares: the number of descriptors with at least one word in the window
};

struct Model {
  const float* shares;        // [block][word][kBlock]
  const float* sums;          // [block][kBlock], sum of a support vector's shares
  const float* coefficients;  // [block][kBlock]
  std::int32_t blocks;
  std::int32_t words;
  float gamma;
};

using Kernel = void (*)(const Model& model, const Histogram* histograms, std::int32_t count,
                        double* sums);

void decide_baseline(const Model& model, const Histogram* histograms, std::int32_t count,
                     double* sums);
/// nullptr where this build or this machine has no AVX2.
Kernel avx2_kernel();
/// The kernel of process_simd_path().
Kernel best_kernel();

}  // namespace weft::detector::chi2
