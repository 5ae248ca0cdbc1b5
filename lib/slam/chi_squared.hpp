#pragma once

#include <string>

#include "base/error.hpp"

namespace weft::slam {

/// Squared Mahalanobis distance below which 95 % of the measurements with Gaussian noise and this
/// many degrees of freedom (1 to 6) lie.
inline double chi_squared_95(int degrees_of_freedom) {
  constexpr double kQuantile[] = {3.841459, 5.991465, 7.814728, 9.487729, 11.070498, 12.591587};
  if (degrees_of_freedom < 1 || degrees_of_freedom > 6) {
    throw Error("chi-squared: " + std::to_string(degrees_of_freedom) +
                " degrees of freedom; expected 1 to 6");
  }
  return kQuantile[degrees_of_freedom - 1];
}

}  // namespace weft::slam
