#include "train/chi2_svm.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::train {
namespace {

constexpr int kWords = 12;

Windows two_kinds(int rows, double mixing, std::uint64_t seed) {
  Random random(seed);
  Windows windows;
  windows.blocks = {{"d", 0, kWords}};
  for (int i = 0; i < rows; ++i) {
    const bool positive = i % 3 == 0;
    for (int w = 0; w < kWords; ++w) {
      const bool typical = (w < kWords / 2) == positive || random.uniform() < mixing;
      windows.counts.push_back(static_cast<std::int32_t>(random.below(typical ? 20 : 4)));
    }
    windows.counts[static_cast<std::size_t>(i) * kWords] += 1;  // never empty
    windows.positive.push_back(positive);
    windows.fold.push_back(i / 3 % 4);
  }
  return windows;
}

TEST(Chi2Svm, SeparatesWhatIsSeparable) {
  const auto windows = two_kinds(120, 0.0, 1);
  const auto result = train_chi2_svm(windows, 4, {});
  EXPECT_GT(result.cross_validated_ap, 0.999);
  EXPECT_EQ(result.samples, 120);
  EXPECT_EQ(result.tried.size(), 12u);
  detector::RefineModel model;
  model.blocks = windows.blocks;
  model.parts = {result.svm};
  model.parts[0].part = "jeans hips";
  model.parts[0].shapes = {{10, 10}};
  const detector::Refiner refiner(model, {});
  for (int i = 0; i < 120; ++i) {
    const auto begin = windows.counts.begin() + static_cast<std::ptrdiff_t>(i) * kWords;
    EXPECT_EQ(refiner.decide(0, {begin, begin + kWords}) > 0.0,
              windows.positive[static_cast<std::size_t>(i)] != 0);
  }
}

// At the optimum of the dual, samples that are no support vectors lie outside the margin and free
// ones on it (Karush, Kuhn, Tucker).
TEST(Chi2Svm, MeetsTheOptimalityConditions) {
  const auto windows = two_kinds(90, 0.5, 2);
  SvmOptions options;
  options.c = {2.0};
  options.gamma_factors = {1.0};
  const auto result = train_chi2_svm(windows, 4, options);
  const auto decide = [&](int i) {
    double f = -result.svm.rho;
    for (int s = 0; s < result.svm.support_vectors(); ++s) {
      const double d =
          detector::chi2_distance(windows.counts.data() + i * kWords,
                                  result.svm.counts.data() + s * kWords, windows.blocks);
      f += result.svm.coefficients[static_cast<std::size_t>(s)] * std::exp(-result.svm.gamma * d);
    }
    return f;
  };
  double balance = 0.0;
  for (const double a : result.svm.coefficients) {
    balance += a;
    EXPECT_LE(std::abs(a), 2.0 + 1e-9);
  }
  EXPECT_NEAR(balance, 0.0, 1e-6);
  int inside = 0;
  for (int i = 0; i < 90; ++i) {
    const double margin = windows.positive[static_cast<std::size_t>(i)] ? decide(i) : -decide(i);
    double alpha = 0.0;
    for (int s = 0; s < result.svm.support_vectors(); ++s) {
      if (std::equal(windows.counts.begin() + i * kWords, windows.counts.begin() + (i + 1) * kWords,
                     result.svm.counts.begin() + s * kWords)) {
        alpha = std::abs(result.svm.coefficients[static_cast<std::size_t>(s)]);
      }
    }
    if (alpha == 0.0) {
      EXPECT_GT(margin, 1.0 - 0.01);
    }
    if (alpha > 1e-6 && alpha < 2.0 - 1e-6) {
      EXPECT_NEAR(margin, 1.0, 0.01);
    }
    inside += margin < 1.0 - 0.01;
    if (margin < 1.0 - 0.01) {
      EXPECT_NEAR(alpha, 2.0, 1e-6);
    }
  }
  EXPECT_GT(inside, 0);  // or the test proves little
}

TEST(Chi2Svm, KeepsTheLimitOfSupportVectors) {
  SvmOptions options;
  options.max_support_vectors = 40;
  const auto result = train_chi2_svm(two_kinds(200, 0.9, 3), 4, options);
  EXPECT_LE(result.svm.support_vectors(), 40);
  EXPECT_LT(result.samples, 200);
}

TEST(Chi2Svm, FewerSupportVectorsDecideAlike) {
  const auto windows = two_kinds(240, 0.8, 6);
  SvmOptions options;
  options.c = {1.0};
  options.gamma_factors = {1.0};
  const auto decide = [&](const detector::PartSvm& svm, int i) {
    double f = -svm.rho;
    for (int s = 0; s < svm.support_vectors(); ++s) {
      const double d = detector::chi2_distance(windows.counts.data() + i * kWords,
                                               svm.counts.data() + s * kWords, windows.blocks);
      f += svm.coefficients[static_cast<std::size_t>(s)] * std::exp(-svm.gamma * d);
    }
    return f;
  };
  const auto full = train_chi2_svm(windows, 4, options);
  // Root mean square of the difference, as a share of the decision values' own.
  const auto error = [&](const detector::PartSvm& svm) {
    double squares = 0.0, scale = 0.0;
    for (int i = 0; i < 240; ++i) {
      const double f = decide(full.svm, i);
      squares += (decide(svm, i) - f) * (decide(svm, i) - f);
      scale += f * f;
    }
    return std::sqrt(squares / scale);
  };
  ASSERT_GT(full.svm.support_vectors(), 90);
  double before = 1.0;
  for (const int count : {10, 30, 90}) {
    options.reduced_to = count;
    const auto reduced = train_chi2_svm(windows, 4, options);
    EXPECT_EQ(reduced.svm.support_vectors(), count);
    EXPECT_EQ(reduced.full_support_vectors, full.svm.support_vectors());
    for (const auto& svm : reduced.without_fold) EXPECT_LE(svm.support_vectors(), count);
    EXPECT_NEAR(reduced.cross_validated_ap, full.cross_validated_ap, 0.1);
    const double now = error(reduced.svm);
    EXPECT_LT(now, before);
    before = now;
    // Better than what the heaviest support vectors alone say.
    auto heaviest = full.svm;
    std::vector<int> order(full.svm.coefficients.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
    std::sort(order.begin(), order.end(), [&](int a, int b) {
      return std::abs(full.svm.coefficients[static_cast<std::size_t>(a)]) >
             std::abs(full.svm.coefficients[static_cast<std::size_t>(b)]);
    });
    for (std::size_t i = static_cast<std::size_t>(count); i < order.size(); ++i)
      heaviest.coefficients[static_cast<std::size_t>(order[i])] = 0.0;
    EXPECT_LT(now, 0.5 * error(heaviest));
  }
  EXPECT_LT(before, 0.15);
  options.reduced_to = 100000;
  EXPECT_EQ(train_chi2_svm(windows, 4, options).svm.coefficients, full.svm.coefficients);
}

TEST(Chi2Svm, SameInputSameModel) {
  const auto windows = two_kinds(100, 0.5, 4);
  const auto a = train_chi2_svm(windows, 4, {}), b = train_chi2_svm(windows, 4, {});
  EXPECT_EQ(a.svm.coefficients, b.svm.coefficients);
  EXPECT_EQ(a.svm.counts, b.svm.counts);
  EXPECT_EQ(a.svm.platt_a, b.svm.platt_a);
}

TEST(Chi2Svm, RefusesOneClass) {
  auto windows = two_kinds(30, 0.0, 5);
  for (auto& p : windows.positive) p = 0;
  EXPECT_THROW(train_chi2_svm(windows, 4, {}), Error);
}

}  // namespace
}  // namespace weft::train
