#pragma once

#include <cstddef>
#include <vector>

namespace weft::descriptor {

/// Coefficients of exp(-t x), 0 <= x <= lambda, in Chebyshev polynomials of 2 x / lambda - 1:
/// e^-z I_j(z) with z = t lambda / 2, times (-1)^j and, but for j = 0, 2. Times and bounds both lie
/// on the ladder 2^(n / steps_per_octave), so that one row serves all their pairs of one product.
class HeatSeries {
 public:
  /// Rows for t_min * 2^(i / steps_per_octave), i in [0, samples), times a bound of the ladder's
  /// steps [first, last].
  HeatSeries(double t_min, int samples, int steps_per_octave, int first, int last);

  /// The ladder's first step that is not below the eigenvalue, 2^-20 to 2^8.
  static int step_for(double eigenvalue, int steps_per_octave);
  static double bound(int step, int steps_per_octave);

  struct Row {
    double z;
    int count;             // of coefficients, a multiple of 8; more add less than 1e-7
    const double* values;  // those of j = 1 (once more, for -1), 0, 1, ..., count
  };
  Row row(int step, int sample) const;
  /// Coefficients of the row with the most.
  int most(int step) const { return row(step, samples_ - 1).count; }

 private:
  int first_, samples_;
  std::vector<double> z_;
  std::vector<int> counts_;
  std::vector<std::size_t> starts_;
  std::vector<double> values_;
};

}  // namespace weft::descriptor
