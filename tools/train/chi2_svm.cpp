#include "train/chi2_svm.hpp"

#include <svm.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "train/logistic.hpp"

namespace weft::train {
namespace {

struct Decision {  // of one trained SVM
  std::vector<int> rows;
  std::vector<double> coefficients;
  double rho = 0.0;
};

/// LIBSVM wants one node a kernel value; the rows hold all columns, of which a training subset is
/// picked by copying.
Decision train_subset(const std::vector<float>& kernel, int n, const std::vector<char>& positive,
                      const std::vector<int>& subset, double c, double positive_weight) {
  const auto count = subset.size();
  std::vector<svm_node> nodes(count * (count + 2));
  std::vector<svm_node*> rows(count);
  std::vector<double> labels(count);
  for (std::size_t i = 0; i < count; ++i) {
    svm_node* row = nodes.data() + i * (count + 2);
    rows[i] = row;
    row[0] = {0, static_cast<double>(i + 1)};
    const float* values =
        kernel.data() + static_cast<std::size_t>(subset[i]) * static_cast<std::size_t>(n);
    for (std::size_t j = 0; j < count; ++j) {
      row[j + 1] = {static_cast<int>(j + 1), values[subset[j]]};
    }
    row[count + 1] = {-1, 0.0};
    labels[i] = positive[static_cast<std::size_t>(subset[i])] ? 1.0 : -1.0;
  }
  svm_problem problem{static_cast<int>(count), labels.data(), rows.data()};
  svm_parameter parameter{};
  parameter.svm_type = C_SVC;
  parameter.kernel_type = PRECOMPUTED;
  parameter.cache_size = 200;
  parameter.eps = 0.001;
  parameter.C = c;
  parameter.shrinking = 1;
  int weight_label[1] = {1};
  double weight[1] = {positive_weight};
  parameter.nr_weight = 1;
  parameter.weight_label = weight_label;
  parameter.weight = weight;
  if (const char* error = svm_check_parameter(&problem, &parameter)) throw Error(error);
  svm_model* model = svm_train(&problem, &parameter);
  if (model->nr_class != 2) {
    svm_free_and_destroy_model(&model);
    throw Error("samples of one class only; use more scenes");
  }
  Decision decision;
  const double sign = model->label[0] == 1 ? 1.0 : -1.0;
  decision.rho = sign * model->rho[0];
  for (int i = 0; i < model->l; ++i) {
    decision.rows.push_back(subset[static_cast<std::size_t>(model->sv_indices[i] - 1)]);
    decision.coefficients.push_back(sign * model->sv_coef[0][i]);
  }
  svm_free_and_destroy_model(&model);
  return decision;
}

double decide(const std::vector<float>& kernel, int n, const Decision& decision, int row) {
  double sum = -decision.rho;
  const float* values = kernel.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(n);
  for (std::size_t i = 0; i < decision.rows.size(); ++i) {
    sum += decision.coefficients[i] * static_cast<double>(values[decision.rows[i]]);
  }
  return sum;
}

std::vector<int> all_but(const std::vector<int>& fold, int held_out) {
  std::vector<int> rows;
  for (std::size_t i = 0; i < fold.size(); ++i) {
    if (fold[i] != held_out) rows.push_back(static_cast<int>(i));
  }
  return rows;
}

/// Every sample but each `drop`-th one.
Windows thinned(const Windows& windows, int drop) {
  Windows result;
  result.blocks = windows.blocks;
  const auto words = static_cast<std::ptrdiff_t>(detector::total_entries(windows.blocks));
  for (int i = 0; i < windows.rows(); ++i) {
    if (i % drop == drop - 1) continue;
    const auto at = static_cast<std::size_t>(i);
    const auto begin = windows.counts.begin() + i * words;
    result.counts.insert(result.counts.end(), begin, begin + words);
    result.positive.push_back(windows.positive[at]);
    result.fold.push_back(windows.fold[at]);
  }
  return result;
}

}  // namespace

SvmResult train_chi2_svm(const Windows& windows, int folds, const SvmOptions& options) {
  svm_set_print_string_function([](const char*) {});
  const int n = windows.rows();
  const int words = detector::total_entries(windows.blocks);
  const auto size = static_cast<std::size_t>(n);
  std::vector<float> distance(size * size, 0.0f);
  double sum = 0.0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < i; ++j) {
      const double d = detector::chi2_distance(
          windows.counts.data() + static_cast<std::ptrdiff_t>(i) * words,
          windows.counts.data() + static_cast<std::ptrdiff_t>(j) * words, windows.blocks);
      distance[static_cast<std::size_t>(i) * size + static_cast<std::size_t>(j)] =
          distance[static_cast<std::size_t>(j) * size + static_cast<std::size_t>(i)] =
              static_cast<float>(d);
      sum += d;
    }
  }
  if (!(sum > 0.0)) throw Error("all training windows are alike; use more scenes");
  const double mean_distance = sum / (0.5 * n * (n - 1));

  struct Setting {
    SvmResult::Tried tried;
    Decision decision;
    std::vector<Decision> without_fold;
    std::vector<double> held_out;
  };
  std::vector<Setting> settings;
  std::vector<float> kernel(distance.size());
  for (const double factor : options.gamma_factors) {
    const double gamma = factor / mean_distance;
    for (std::size_t i = 0; i < kernel.size(); ++i) {
      kernel[i] = static_cast<float>(det::exp(-gamma * static_cast<double>(distance[i])));
    }
    for (const double c : options.c) {
      Setting setting;
      setting.held_out.resize(size);
      for (int fold = 0; fold < folds; ++fold) {
        const auto& decision = setting.without_fold.emplace_back(train_subset(
            kernel, n, windows.positive, all_but(windows.fold, fold), c, options.positive_weight));
        for (int i = 0; i < n; ++i) {
          if (windows.fold[static_cast<std::size_t>(i)] != fold) continue;
          setting.held_out[static_cast<std::size_t>(i)] = decide(kernel, n, decision, i);
        }
      }
      setting.decision = train_subset(kernel, n, windows.positive, all_but(windows.fold, -1), c,
                                      options.positive_weight);
      setting.tried = {c, factor, ranking_ap(setting.held_out, windows.positive),
                       static_cast<int>(setting.decision.rows.size())};
      settings.push_back(std::move(setting));
    }
  }

  const Setting* best = nullptr;
  double best_ap = 0.0;
  for (const auto& s : settings) {
    if (s.tried.support_vectors <= options.max_support_vectors)
      best_ap = std::max(best_ap, s.tried.ap);
  }
  for (const auto& s : settings) {
    if (s.tried.support_vectors > options.max_support_vectors || s.tried.ap < best_ap - 0.005)
      continue;
    if (best == nullptr || s.tried.support_vectors < best->tried.support_vectors) best = &s;
  }
  if (best == nullptr) {
    if (n < 8) throw Error("max_support_vectors is too small to train anything");
    return train_chi2_svm(thinned(windows, 6), folds, options);
  }

  SvmResult result;
  for (const auto& s : settings) result.tried.push_back(s.tried);
  result.c = best->tried.c;
  result.gamma_factor = best->tried.gamma_factor;
  result.cross_validated_ap = best->tried.ap;
  result.samples = n;
  const auto sigmoid = fit_sigmoid(best->held_out, windows.positive);
  const auto svm_of = [&](const Decision& decision) {
    detector::PartSvm svm;
    svm.gamma = best->tried.gamma_factor / mean_distance;
    svm.rho = decision.rho;
    svm.coefficients = decision.coefficients;
    for (const int row : decision.rows) {
      const auto begin = windows.counts.begin() + static_cast<std::ptrdiff_t>(row) * words;
      svm.counts.insert(svm.counts.end(), begin, begin + words);
    }
    svm.platt_a = sigmoid.a;
    svm.platt_b = sigmoid.b;
    return svm;
  };
  result.svm = svm_of(best->decision);
  for (const auto& decision : best->without_fold) result.without_fold.push_back(svm_of(decision));
  std::vector<double> log_odds;
  for (const double f : best->held_out) log_odds.push_back(-(sigmoid.a * f + sigmoid.b));
  result.cross_validated_log_loss = log_loss(log_odds, windows.positive);
  return result;
}

}  // namespace weft::train
