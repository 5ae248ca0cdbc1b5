#pragma once

namespace weft::plane {

constexpr double kRadiansPerDegree = 0.017453292519943295;

/// Cosine of an angle of at most 180 degrees by its series: the same bits everywhere.
inline double cos_degrees(double angle_deg) {
  const double t2 = angle_deg * angle_deg * kRadiansPerDegree * kRadiansPerDegree;
  double term = 1.0, sum = 1.0;
  for (int k = 1; k < 15; ++k) {
    term *= -t2 / ((2 * k - 1) * (2 * k));
    sum += term;
  }
  return sum;
}

}  // namespace weft::plane
