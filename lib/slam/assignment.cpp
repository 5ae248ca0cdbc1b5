#include "slam/assignment.hpp"

#include <cmath>
#include <limits>
#include <string>

#include "base/error.hpp"

namespace weft::slam {

std::vector<int> assign(const Eigen::MatrixXd& costs, double unassigned_cost) {
  const auto rows = static_cast<std::size_t>(costs.rows());
  const auto real = static_cast<std::size_t>(costs.cols());
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (!std::isfinite(unassigned_cost)) {
    throw Error("assignment: the cost of no assignment is " + std::to_string(unassigned_cost) +
                "; expected a finite number");
  }
  for (const double cost : costs.reshaped()) {
    if (std::isnan(cost) || cost == -kInfinity) {
      throw Error("assignment: a cost is " + std::to_string(cost) +
                  "; expected numbers, or infinity for pairs that cannot be");
    }
  }
  // One more column for each row: standing for none at all. Numbers from 1, 0 is the start of a
  // path; row_of[column], potentials u and v as in the dual of the linear program.
  const std::size_t columns = real + rows;
  std::vector<double> u(rows + 1, 0.0), v(columns + 1, 0.0);
  std::vector<std::size_t> row_of(columns + 1, 0), way(columns + 1, 0);
  for (std::size_t row = 1; row <= rows; ++row) {
    row_of[0] = row;
    std::size_t column = 0;
    std::vector<double> slack(columns + 1, kInfinity);
    std::vector<char> used(columns + 1, 0);
    do {
      used[column] = 1;
      const std::size_t at = row_of[column];
      double delta = kInfinity;
      std::size_t next = 0;
      for (std::size_t j = 1; j <= columns; ++j) {
        if (used[j]) continue;
        const double cost =
            j <= real ? costs(static_cast<Eigen::Index>(at - 1), static_cast<Eigen::Index>(j - 1))
                      : unassigned_cost;
        const double reduced = cost - u[at] - v[j];
        if (reduced < slack[j]) {
          slack[j] = reduced;
          way[j] = column;
        }
        if (slack[j] < delta) {
          delta = slack[j];
          next = j;
        }
      }
      for (std::size_t j = 0; j <= columns; ++j) {
        if (used[j]) {
          u[row_of[j]] += delta;
          v[j] -= delta;
        } else {
          slack[j] -= delta;
        }
      }
      column = next;
    } while (row_of[column] != 0);
    do {
      const std::size_t before = way[column];
      row_of[column] = row_of[before];
      column = before;
    } while (column != 0);
  }
  std::vector<int> out(rows, -1);
  for (std::size_t j = 1; j <= real; ++j) {
    if (row_of[j] != 0) out[row_of[j] - 1] = static_cast<int>(j - 1);
  }
  return out;
}

}  // namespace weft::slam
