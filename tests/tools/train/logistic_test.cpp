#include "train/logistic.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::train {
namespace {

Samples noisy_samples(int rows, std::uint64_t seed) {
  Random random(seed);
  Samples samples;
  samples.dimension = 3;
  for (int i = 0; i < rows; ++i) {
    const std::vector<float> x = {static_cast<float>(random.normal()),
                                  static_cast<float>(random.normal()), 0.0f};
    const double p = 1.0 / (1.0 + std::exp(-(2.0 * x[0] - 1.0 * x[1] - 0.5)));
    samples.add(x, random.uniform() < p, i % 4);
  }
  return samples;
}

/// Gradient descent on the same objective.
Logistic brute_force(const Samples& samples, double c, double positive_weight, int held_out) {
  std::vector<double> w(4, 0.0);
  for (int step = 0; step < 20000; ++step) {
    std::vector<double> gradient = w;
    for (int i = 0; i < samples.rows(); ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (samples.fold[at] == held_out) continue;
      const double y = samples.positive[at] ? 1.0 : -1.0;
      double f = w[3];
      for (std::size_t j = 0; j < 3; ++j) f += w[j] * samples.row(i)[j];
      const double factor = -y * c * (y > 0 ? positive_weight : 1.0) / (1.0 + std::exp(y * f));
      for (std::size_t j = 0; j < 3; ++j) gradient[j] += factor * samples.row(i)[j];
      gradient[3] += factor;
    }
    for (std::size_t j = 0; j < 4; ++j) w[j] -= 0.01 * gradient[j];
  }
  return {{w[0], w[1], w[2]}, w[3]};
}

TEST(Logistic, MinimisesTheObjectiveOfTheSamplesThatAreNotHeldOut) {
  const auto samples = noisy_samples(200, 1);
  for (const double weight : {1.0, 3.0}) {
    const auto found = train_logistic(samples, 0.5, weight, 2);
    const auto expected = brute_force(samples, 0.5, weight, 2);
    for (std::size_t j = 0; j < 3; ++j) {
      EXPECT_NEAR(found.weights[j], expected.weights[j], 0.02);
    }
    EXPECT_NEAR(found.bias, expected.bias, 0.02);
    EXPECT_EQ(found.weights[2], 0.0);
  }
}

TEST(Logistic, PositiveSamplesScoreHighWhicheverClassComesFirst) {
  Samples samples;
  samples.dimension = 1;
  for (int i = 0; i < 20; ++i) samples.add({i < 10 ? 0.1f : 0.9f}, i >= 10, 0);
  const float low = 0.0f, high = 1.0f;
  const auto model = train_logistic(samples, 10.0, 1.0);
  EXPECT_LT(model.decide(&low), 0.0);
  EXPECT_GT(model.decide(&high), 0.0);
  for (auto& p : samples.positive) p = 1;
  EXPECT_THROW(train_logistic(samples, 1.0, 1.0), Error);
}

TEST(Logistic, CrossValidationHoldsOutWholeFolds) {
  const auto samples = noisy_samples(120, 2);
  const auto values = cross_validate_logistic(samples, 1.0, 1.0, 4);
  for (int fold = 0; fold < 4; ++fold) {
    const auto model = train_logistic(samples, 1.0, 1.0, fold);
    for (int i = fold; i < 120; i += 4) {
      EXPECT_EQ(values[static_cast<std::size_t>(i)], model.decide(samples.row(i)));
    }
  }
}

TEST(RankingAp, HandWorked) {
  EXPECT_NEAR(ranking_ap({0.9, 0.8, 0.7, 0.1}, {1, 0, 1, 0}), 0.5 * (1.0 + 2.0 / 3), 1e-15);
  EXPECT_NEAR(ranking_ap({0.5, 0.5}, {1, 0}), 0.5, 1e-15);  // a tie is no success
}

TEST(LogLoss, HandWorked) {
  EXPECT_NEAR(log_loss({0.0, 0.0}, {1, 0}), std::log(2.0), 1e-15);
  EXPECT_NEAR(log_loss({2.0}, {1}), std::log(1.0 + std::exp(-2.0)), 1e-15);
  EXPECT_NEAR(log_loss({-50.0}, {1}), 50.0, 1e-12);
}

TEST(Sigmoid, MinimisesPlattsObjective) {
  Random random(3);
  std::vector<double> values;
  std::vector<char> positive;
  for (int i = 0; i < 300; ++i) {
    values.push_back(random.normal() * 2.0);
    positive.push_back(random.uniform() < 1.0 / (1.0 + std::exp(-(1.7 * values.back() + 0.4))));
  }
  const auto fitted = fit_sigmoid(values, positive);
  double ones = 0;
  for (const char p : positive) ones += p;
  const double zeros = 300 - ones;
  const auto objective = [&](double a, double b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double t = positive[i] ? (ones + 1) / (ones + 2) : 1 / (zeros + 2);
      const double p = 1.0 / (1.0 + std::exp(a * values[i] + b));
      sum -= t * std::log(p) + (1 - t) * std::log(1 - p);
    }
    return sum;
  };
  const double best = objective(fitted.a, fitted.b);
  for (const double da : {-0.01, 0.0, 0.01}) {
    for (const double db : {-0.01, 0.0, 0.01}) {
      EXPECT_LE(best, objective(fitted.a + da, fitted.b + db) + 1e-9);
    }
  }
  EXPECT_LT(fitted.a, -1.0);  // P grows with f
}

}  // namespace
}  // namespace weft::train
