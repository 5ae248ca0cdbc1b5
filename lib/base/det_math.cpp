#include "base/det_math.hpp"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace weft::det {
namespace {

double power_of_two(int exponent) {
  const std::uint64_t bits = static_cast<std::uint64_t>(exponent + 1023) << 52;
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

// ln 2 in two pieces: the first has zeros at its end, so that k * kLn2High is exact.
constexpr double kLn2High = 6.93147180369123816490e-01;
constexpr double kLn2Low = 1.90821492927058770002e-10;
constexpr double kPi = 3.14159265358979323846;

// Taylor series around 0, |x| <= tan(pi/16)
double atan_small(double x) {
  const double z = x * x;
  double sum = 0.0;
  for (int n = 23; n >= 1; n -= 2) sum = ((n / 2) % 2 ? -1.0 : 1.0) / n + z * sum;
  return x * sum;
}

double atan_unit(double x) {  // 0 <= x <= 1
  // Two half-angle steps bring the argument below tan(pi/16).
  for (int i = 0; i < 2; ++i) x = x / (1.0 + std::sqrt(1.0 + x * x));
  return 4.0 * atan_small(x);
}

}  // namespace

double exp(double x) {
  if (std::isnan(x)) return x;
  if (x < -708.0) return 0.0;
  if (x > 709.0) return std::numeric_limits<double>::infinity();
  const double k = std::nearbyint(x / (kLn2High + kLn2Low));
  const double r = (x - k * kLn2High) - k * kLn2Low;  // |r| <= ln 2 / 2
  double sum = 1.0;
  for (int n = 14; n >= 1; --n) sum = 1.0 + r * sum / n;
  return sum * power_of_two(static_cast<int>(k));
}

double log(double x) {
  int exponent;
  double m = std::frexp(x, &exponent);
  if (m < 0.70710678118654752440) {
    m *= 2.0;
    --exponent;
  }
  const double s = (m - 1.0) / (m + 1.0);  // log m = 2 atanh s
  const double z = s * s;
  double sum = 0.0;
  for (int n = 23; n >= 1; n -= 2) sum = 1.0 / n + z * sum;
  return exponent * kLn2High + (exponent * kLn2Low + 2.0 * s * sum);
}

double atan2(double y, double x) {
  const double ax = std::fabs(x), ay = std::fabs(y);
  if (ax == 0.0 && ay == 0.0) return 0.0;
  double angle = ay <= ax ? atan_unit(ay / ax) : kPi / 2 - atan_unit(ax / ay);
  if (x < 0.0) angle = kPi - angle;
  return std::signbit(y) && ay != 0.0 ? -angle : angle;
}

}  // namespace weft::det
