#include "slam/assignment.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::slam {
namespace {

double total(const Eigen::MatrixXd& costs, double unassigned, const std::vector<int>& columns) {
  double sum = 0.0;
  for (Eigen::Index row = 0; row < costs.rows(); ++row) {
    const int column = columns[static_cast<std::size_t>(row)];
    sum += column < 0 ? unassigned : costs(row, column);
  }
  return sum;
}

/// Tries everything.
double least_total(const Eigen::MatrixXd& costs, double unassigned) {
  std::vector<char> used(static_cast<std::size_t>(costs.cols()), 0);
  const std::function<double(Eigen::Index)> from = [&](Eigen::Index row) {
    if (row == costs.rows()) return 0.0;
    double best = unassigned + from(row + 1);
    for (Eigen::Index column = 0; column < costs.cols(); ++column) {
      auto& taken = used[static_cast<std::size_t>(column)];
      if (taken) continue;
      taken = 1;
      best = std::min(best, costs(row, column) + from(row + 1));
      taken = 0;
    }
    return best;
  };
  return from(0);
}

TEST(Assignment, IsTheLeastOfAll) {
  Random random(1);
  for (int i = 0; i < 400; ++i) {
    Eigen::MatrixXd costs(random.integer(0, 6), random.integer(0, 6));
    for (double& cost : costs.reshaped()) {
      cost = random.uniform() < 0.2 ? std::numeric_limits<double>::infinity()
             : i % 2                ? static_cast<double>(random.integer(-3, 3))  // many ties
                                    : random.uniform(-1.0, 2.0);
    }
    const double unassigned = random.uniform(-0.5, 1.5);
    const auto columns = assign(costs, unassigned);
    ASSERT_EQ(columns.size(), static_cast<std::size_t>(costs.rows()));
    std::vector<int> uses(static_cast<std::size_t>(costs.cols()), 0);
    for (const int column : columns) {
      ASSERT_GE(column, -1);
      ASSERT_LT(column, costs.cols());
      if (column >= 0) {
        EXPECT_EQ(++uses[static_cast<std::size_t>(column)], 1);
      }
    }
    EXPECT_NEAR(total(costs, unassigned, columns), least_total(costs, unassigned), 1e-9);
    EXPECT_EQ(assign(costs, unassigned), columns);
  }
}

TEST(Assignment, IsNotNearestFirst) {
  // Nearest first would pair (0, 0) for 1 and be left with 10.
  const Eigen::MatrixXd costs{{1.0, 2.0}, {2.0, 10.0}};
  EXPECT_EQ(assign(costs, 100.0), (std::vector<int>{1, 0}));
}

TEST(Assignment, PairsOnlyWhereThatIsCheaper) {
  const Eigen::MatrixXd costs{{1.0, 8.0}, {8.0, 8.0}};
  EXPECT_EQ(assign(costs, 5.0), (std::vector<int>{0, -1}));
}

TEST(Assignment, WhatCannotBeIsRefused) {
  EXPECT_THROW(assign(Eigen::MatrixXd::Constant(1, 1, std::nan("")), 1.0), Error);
  EXPECT_THROW(
      assign(Eigen::MatrixXd::Constant(1, 1, -std::numeric_limits<double>::infinity()), 1.0),
      Error);
  EXPECT_THROW(assign(Eigen::MatrixXd::Ones(1, 1), std::numeric_limits<double>::infinity()), Error);
}

}  // namespace
}  // namespace weft::slam
