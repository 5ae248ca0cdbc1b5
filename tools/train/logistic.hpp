#pragma once

#include <vector>

/// Logistic regression by LIBLINEAR, and what choosing its C needs.
namespace weft::train {

/// Training samples: rows of features, a label each, and the fold they are held out in. All samples
/// of a simulation are in one fold.
struct Samples {
  int dimension = 0;
  std::vector<float> values;  // rows * dimension
  std::vector<char> positive;
  std::vector<int> fold;

  int rows() const { return static_cast<int>(positive.size()); }
  const float* row(int i) const {
    return values.data() + static_cast<std::ptrdiff_t>(i) * dimension;
  }
  void add(const std::vector<float>& features, bool is_positive, int fold_index);
  int positives() const;
};

struct Logistic {
  std::vector<double> weights;
  double bias = 0.0;
  double decide(const float* features) const;
};

/// min_w |w|^2 / 2 + C sum_i c_i log(1 + exp(-y_i w.x_i)) over the samples outside `held_out` (-1:
/// all), the bias being the weight of a constant feature 1. c_i is positive_weight for positives
/// and 1 for negatives. Throws Error when a class is missing.
Logistic train_logistic(const Samples& samples, double c, double positive_weight,
                        int held_out = -1);

/// Decision value of each sample by a model trained without its fold.
std::vector<double> cross_validate_logistic(const Samples& samples, double c,
                                            double positive_weight, int folds);

/// Average precision (all points) of decision values; of equal values negatives rank first.
double ranking_ap(const std::vector<double>& values, const std::vector<char>& positive);

/// Mean negative log-likelihood of logistic decision values.
double log_loss(const std::vector<double>& values, const std::vector<char>& positive);

struct Sigmoid {
  double a = -1.0, b = 0.0;  // P = 1 / (1 + exp(a f + b))
};

/// Platt's sigmoid by the Newton method of Lin, Lin and Weng (2007), as in LIBSVM, but on decision
/// values the caller cross-validated with his own folds: no random shuffle.
Sigmoid fit_sigmoid(const std::vector<double>& values, const std::vector<char>& positive);

}  // namespace weft::train
