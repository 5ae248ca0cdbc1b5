#pragma once

#include <cstdint>
#include <vector>

#include "base/options.hpp"
#include "detector/refiner.hpp"

/// Chi-squared SVM by LIBSVM on a precomputed kernel.
namespace weft::train {

struct SvmOptions {
  std::vector<double> c = {1.0, 4.0, 16.0};
  std::vector<double> gamma_factors = {0.5, 1.0, 2.0, 4.0};
  double positive_weight = 1.0;
  int max_support_vectors = 500;
  int reduced_to = 0;

  void visit(OptionVisitor& v) {
    v.field("c", c, {1, 20}, "", "values of C tried");
    v.field("gamma_factors", gamma_factors, {1, 20}, "",
            "values of gamma tried, in units of 1 / mean distance of the training pairs");
    v.field("positive_weight", positive_weight, {0.01, 1000.0}, "",
            "C of positives over C of negatives");
    v.field("max_support_vectors", max_support_vectors, {2, 100000}, "",
            "settings with more are not chosen; if all have more, samples are left out: each costs "
            "the second layer time");
    v.field("reduced_to", reduced_to, {0, 100000}, "",
            "support vectors kept, those that the decision values of all training windows are "
            "fitted with best; 0: all. Model files and the second layer's time shrink with them");
  }
  void validate() const { validate_fields(*this, "SvmOptions"); }
};

/// Word counts of training windows.
struct Windows {
  std::vector<detector::HistogramBlock> blocks;
  std::vector<std::int32_t> counts;  // rows * total_entries(blocks)
  std::vector<char> positive;
  std::vector<int> fold;

  int rows() const { return static_cast<int>(positive.size()); }
};

struct SvmResult {
  detector::PartSvm svm;  // but for part and shapes
  /// The same trained without one fold each: what scores unseen windows of that fold.
  std::vector<detector::PartSvm> without_fold;
  double c = 0.0;
  double gamma_factor = 0.0;
  double cross_validated_ap = 0.0;
  double cross_validated_log_loss = 0.0;
  int samples = 0;
  int full_support_vectors = 0;  // before they were reduced
  struct Tried {
    double c, gamma_factor, ap;
    int support_vectors;
  };
  std::vector<Tried> tried;
};

/// Chooses C and gamma by the average precision of held-out folds (within 0.5 % of the best: the
/// fewest support vectors), trains on everything and fits Platt's sigmoid to the held-out decision
/// values. With options.reduced_to the chosen SVM, and those without one fold each, are then
/// replaced by sums of fewer kernels: support vectors are picked one after the other by pivoted
/// Cholesky factorisation of their kernel matrix weighted with their coefficients, and coefficients
/// and bias fitted anew to the decision values of the training windows by least squares. Throws
/// Error when a class is missing.
SvmResult train_chi2_svm(const Windows& windows, int folds, const SvmOptions& options);

}  // namespace weft::train
