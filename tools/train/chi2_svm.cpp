#include "train/chi2_svm.hpp"

#include <svm.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

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

/// detector::chi2_distance between training windows, of which few words are not zero.
class Distances {
 public:
  explicit Distances(const Windows& windows) : words_(detector::total_entries(windows.blocks)) {
    shares_.reserve(windows.counts.size());
    for (const std::int32_t* counts = windows.counts.data();
         counts != windows.counts.data() + windows.counts.size();) {
      Row row{entries_.size(), 0, 0.0};
      int word = 0;
      for (const auto& block : windows.blocks) {
        const auto end = counts + block.entries();
        const double total = std::accumulate(counts, end, 0);
        if (total > 0) row.sum += 1.0;
        for (; counts != end; ++counts, ++word) {
          shares_.push_back(*counts > 0 ? *counts / total : 0.0);
          if (*counts > 0) entries_.push_back({word, shares_.back()});
        }
      }
      row.end = entries_.size();
      rows_.push_back(row);
    }
  }
  /// Of two windows: sum (x-t)^2 / (x+t) = sum x + sum t - 4 sum x t / (x+t).
  double operator()(int i, int j) const {
    const Row& row = rows_[static_cast<std::size_t>(i)];
    const double* other = shares_.data() + static_cast<std::ptrdiff_t>(j) * words_;
    double common = 0.0;
    for (std::size_t e = row.begin; e < row.end; ++e) {
      const double x = entries_[e].share, t = other[entries_[e].word];
      common += x * t / (x + t);
    }
    return row.sum + rows_[static_cast<std::size_t>(j)].sum - 4.0 * common;
  }

 private:
  struct Entry {
    int word;
    double share;
  };
  struct Row {
    std::size_t begin, end;  // of its entries
    double sum;              // of its shares
  };
  int words_;
  std::vector<double> shares_;  // rows * words
  std::vector<Entry> entries_;
  std::vector<Row> rows_;
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

/// The places in `rows` of the `count` support vectors that span the others best: the pivots of a
/// Cholesky factorisation of A K A, A the diagonal of the coefficients' magnitudes.
std::vector<std::size_t> pivots(const std::vector<float>& kernel, int n, const Decision& decision,
                                std::size_t count) {
  const auto size = static_cast<Eigen::Index>(decision.rows.size());
  Eigen::MatrixXd factor(size, static_cast<Eigen::Index>(count));
  Eigen::VectorXd left(size);  // what the chosen ones do not explain of each one's own norm
  const auto weight = [&](Eigen::Index i) {
    return std::abs(decision.coefficients[static_cast<std::size_t>(i)]);
  };
  for (Eigen::Index i = 0; i < size; ++i) left[i] = weight(i) * weight(i);
  std::vector<std::size_t> chosen;
  for (Eigen::Index k = 0; k < factor.cols(); ++k) {
    Eigen::Index best = 0;
    if (!(left.maxCoeff(&best) > 0.0)) break;
    const float* values =
        kernel.data() + static_cast<std::size_t>(decision.rows[static_cast<std::size_t>(best)]) *
                            static_cast<std::size_t>(n);
    Eigen::VectorXd column(size);
    for (Eigen::Index i = 0; i < size; ++i)
      column[i] = weight(i) * weight(best) *
                  static_cast<double>(values[decision.rows[static_cast<std::size_t>(i)]]);
    column -= factor.leftCols(k) * factor.row(best).head(k).transpose();
    factor.col(k) = column / std::sqrt(left[best]);
    left -= factor.col(k).cwiseAbs2();
    left[best] = 0.0;
    chosen.push_back(static_cast<std::size_t>(best));
  }
  return chosen;
}

/// A decision of at most `count` support vectors whose values on the rows of `subset` are nearest.
Decision reduce(const std::vector<float>& kernel, int n, const Decision& decision,
                const std::vector<int>& subset, std::size_t count) {
  if (decision.rows.size() <= count) return decision;
  const auto chosen = pivots(kernel, n, decision, count);
  Decision reduced;
  for (const auto i : chosen) reduced.rows.push_back(decision.rows[i]);
  // One more column, of ones, for the bias.
  const auto rows = static_cast<Eigen::Index>(subset.size());
  const auto columns = static_cast<Eigen::Index>(chosen.size());
  Eigen::MatrixXd a(rows, columns + 1);
  Eigen::VectorXd wanted(rows);
  for (Eigen::Index i = 0; i < rows; ++i) {
    const int row = subset[static_cast<std::size_t>(i)];
    const float* values =
        kernel.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(n);
    for (Eigen::Index k = 0; k < columns; ++k)
      a(i, k) = static_cast<double>(values[reduced.rows[static_cast<std::size_t>(k)]]);
    a(i, columns) = 1.0;
    wanted[i] = decide(kernel, n, decision, row);
  }
  Eigen::MatrixXd normal = a.transpose() * a;
  // Kernels are smooth, and single precision: hardly a direction more than these is determined.
  normal.diagonal().array() += 1e-6 * normal.diagonal().mean();
  const Eigen::VectorXd solution = normal.ldlt().solve(a.transpose() * wanted);
  reduced.coefficients.assign(solution.data(), solution.data() + columns);
  reduced.rho = -solution[columns];
  return reduced;
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
  const Distances distances(windows);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < i; ++j) {
      const double d = distances(i, j);
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

  Setting* best = nullptr;
  double best_ap = 0.0;
  for (const auto& s : settings) {
    if (s.tried.support_vectors <= options.max_support_vectors)
      best_ap = std::max(best_ap, s.tried.ap);
  }
  for (auto& s : settings) {
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
  result.full_support_vectors = best->tried.support_vectors;
  if (options.reduced_to > 0) {
    const double gamma = best->tried.gamma_factor / mean_distance;
    for (std::size_t i = 0; i < kernel.size(); ++i)
      kernel[i] = static_cast<float>(det::exp(-gamma * static_cast<double>(distance[i])));
    const auto count = static_cast<std::size_t>(options.reduced_to);
    for (int fold = -1; fold < folds; ++fold) {
      auto& decision =
          fold < 0 ? best->decision : best->without_fold[static_cast<std::size_t>(fold)];
      decision = reduce(kernel, n, decision, all_but(windows.fold, fold), count);
      for (int i = 0; fold >= 0 && i < n; ++i) {
        if (windows.fold[static_cast<std::size_t>(i)] == fold)
          best->held_out[static_cast<std::size_t>(i)] = decide(kernel, n, decision, i);
      }
    }
    result.cross_validated_ap = ranking_ap(best->held_out, windows.positive);
  }
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
