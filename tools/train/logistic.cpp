#include "train/logistic.hpp"

#include <linear.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "evaluation/part_metrics.hpp"

namespace weft::train {

void Samples::add(const std::vector<float>& features, bool is_positive, int fold_index) {
  values.insert(values.end(), features.begin(), features.end());
  positive.push_back(is_positive);
  fold.push_back(fold_index);
}

int Samples::positives() const {
  return static_cast<int>(std::count(positive.begin(), positive.end(), 1));
}

double Logistic::decide(const float* features) const {
  double sum = bias;
  for (std::size_t j = 0; j < weights.size(); ++j) sum += weights[j] * features[j];
  return sum;
}

Logistic train_logistic(const Samples& samples, double c, double positive_weight, int held_out) {
  ::set_print_string_function([](const char*) {});
  std::vector<feature_node> nodes;
  std::vector<std::size_t> begins;
  std::vector<double> labels;
  // LIBLINEAR makes the class it meets first the positive one.
  for (const bool positive : {true, false}) {
    const auto before = begins.size();
    for (int i = 0; i < samples.rows(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (samples.fold[at] == held_out || (samples.positive[at] != 0) != positive) continue;
      begins.push_back(nodes.size());
      for (int j = 0; j < samples.dimension; ++j) {
        if (samples.row(i)[j] != 0.0f) nodes.push_back({j + 1, samples.row(i)[j]});
      }
      nodes.push_back({samples.dimension + 1, 1.0});
      nodes.push_back({-1, 0.0});
      labels.push_back(positive ? 1.0 : -1.0);
    }
    if (begins.size() == before) {
      throw Error(std::string("no ") + (positive ? "positive" : "negative") +
                  " samples to train from; use more scenes");
    }
  }
  std::vector<feature_node*> rows;
  for (const auto begin : begins) rows.push_back(nodes.data() + begin);
  problem data{};
  data.l = static_cast<int>(rows.size());
  data.n = samples.dimension + 1;
  data.y = labels.data();
  data.x = rows.data();
  data.bias = 1.0;
  int weight_label[1] = {1};
  double weight[1] = {positive_weight};
  parameter options{};
  options.solver_type = L2R_LR;
  options.eps = 0.001;
  options.C = c;
  options.nr_weight = 1;
  options.weight_label = weight_label;
  options.weight = weight;
  if (const char* error = check_parameter(&data, &options)) throw Error(error);
  model* trained = ::train(&data, &options);
  Logistic result;
  result.weights.assign(trained->w, trained->w + samples.dimension);
  result.bias = trained->w[samples.dimension];
  free_and_destroy_model(&trained);
  return result;
}

std::vector<double> cross_validate_logistic(const Samples& samples, double c,
                                            double positive_weight, int folds) {
  std::vector<double> values(static_cast<std::size_t>(samples.rows()));
  for (int fold = 0; fold < folds; ++fold) {
    const auto model = train_logistic(samples, c, positive_weight, fold);
    for (int i = 0; i < samples.rows(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (samples.fold[at] == fold) values[at] = model.decide(samples.row(i));
    }
  }
  return values;
}

double ranking_ap(const std::vector<double>& values, const std::vector<char>& positive) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return values[a] != values[b] ? values[a] > values[b] : positive[a] < positive[b];
  });
  std::vector<bool> hits;
  for (const auto i : order) hits.push_back(positive[i] != 0);
  return evaluation::average_precision(
             hits, static_cast<int>(std::count(positive.begin(), positive.end(), 1)))
      .all_points;
}

double log_loss(const std::vector<double>& values, const std::vector<char>& positive) {
  double sum = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double margin = positive[i] ? values[i] : -values[i];
    sum +=
        margin > 0 ? det::log(1.0 + det::exp(-margin)) : -margin + det::log(1.0 + det::exp(margin));
  }
  return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
}

Sigmoid fit_sigmoid(const std::vector<double>& values, const std::vector<char>& positive) {
  const double ones = static_cast<double>(std::count(positive.begin(), positive.end(), 1));
  const double zeros = static_cast<double>(positive.size()) - ones;
  const double high = (ones + 1.0) / (ones + 2.0), low = 1.0 / (zeros + 2.0);
  const auto target = [&](std::size_t i) { return positive[i] ? high : low; };
  // t f + log(1 + exp(-f)) without overflow, f = a v + b
  const auto objective = [&](const Sigmoid& s) {
    double sum = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double f = values[i] * s.a + s.b;
      sum += f >= 0 ? target(i) * f + det::log(1.0 + det::exp(-f))
                    : (target(i) - 1.0) * f + det::log(1.0 + det::exp(f));
    }
    return sum;
  };
  Sigmoid sigmoid{0.0, det::log((zeros + 1.0) / (ones + 1.0))};
  double best = objective(sigmoid);
  for (int iteration = 0; iteration < 100; ++iteration) {
    double h11 = 1e-12, h22 = 1e-12, h21 = 0.0, g1 = 0.0, g2 = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double p = det::logistic(-(values[i] * sigmoid.a + sigmoid.b));
      const double d2 = p * (1.0 - p), d1 = target(i) - p;
      h11 += values[i] * values[i] * d2;
      h22 += d2;
      h21 += values[i] * d2;
      g1 += values[i] * d1;
      g2 += d1;
    }
    if (std::abs(g1) < 1e-5 && std::abs(g2) < 1e-5) break;
    const double det = h11 * h22 - h21 * h21;
    const double da = -(h22 * g1 - h21 * g2) / det, db = -(h11 * g2 - h21 * g1) / det;
    const double slope = g1 * da + g2 * db;
    double step = 1.0;
    for (; step >= 1e-10; step /= 2.0) {
      const Sigmoid next{sigmoid.a + step * da, sigmoid.b + step * db};
      const double value = objective(next);
      if (value < best + 1e-4 * step * slope) {
        sigmoid = next;
        best = value;
        break;
      }
    }
    if (step < 1e-10) break;
  }
  return sigmoid;
}

}  // namespace weft::train
