#include "descriptor/heat_series.hpp"

#include <algorithm>
#include <cmath>

#include "base/det_math.hpp"

namespace weft::descriptor {
namespace {

constexpr double kLeftOut = 1e-7;  // of a sum that is at least the centre's share of the patch

double ladder(int step, int steps_per_octave) {
  return det::exp(0.69314718055994530942 * step / steps_per_octave);
}

// e^-z I_j(z), j in [0, count + 1], by Miller's downward recurrence; count such that all beyond add
// up to less than kLeftOut.
std::vector<double> scaled_bessel(double z) {
  // Beyond sqrt(2 z ln(1 / error)) the coefficients fall off faster than a Gaussian.
  const int start =
      64 + static_cast<int>(1.5 * std::sqrt(2.0 * z * 40.0)) + static_cast<int>(z < 64 ? 2 * z : 0);
  std::vector<double> values(static_cast<std::size_t>(start) + 2, 0.0);
  double above = 0.0, here = 1e-290, total = 0.0;
  for (int j = start; j >= 0; --j) {
    values[static_cast<std::size_t>(j)] = here;
    total += j > 0 ? 2.0 * here : here;
    const double below = above + 2.0 * j / z * here;
    above = here;
    here = below;
    if (here > 1e200) {
      for (std::size_t i = static_cast<std::size_t>(j); i < values.size(); ++i) values[i] *= 1e-250;
      above *= 1e-250;
      here *= 1e-250;
      total *= 1e-250;
    }
  }
  for (double& v : values) v /= total;
  double left_out = 0.0;
  int count = start;
  while (count > 1 && left_out + 2.0 * values[static_cast<std::size_t>(count - 1)] < kLeftOut)
    left_out += 2.0 * values[static_cast<std::size_t>(--count)];
  count = (count + 7) / 8 * 8;
  values.resize(static_cast<std::size_t>(count) + 1, 0.0);
  return values;
}

}  // namespace

int HeatSeries::step_for(double eigenvalue, int steps_per_octave) {
  int low = -20 * steps_per_octave, high = 8 * steps_per_octave;
  while (low < high) {
    const int middle = low + (high - low) / 2;
    if (ladder(middle, steps_per_octave) >= eigenvalue) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

double HeatSeries::bound(int step, int steps_per_octave) { return ladder(step, steps_per_octave); }

HeatSeries::HeatSeries(double t_min, int samples, int steps_per_octave, int first, int last)
    : first_(first), samples_(samples) {
  for (int step = first; step < last + samples; ++step) {
    z_.push_back(0.5 * t_min * ladder(step, steps_per_octave));
    const auto values = scaled_bessel(z_.back());
    counts_.push_back(static_cast<int>(values.size()) - 1);
    starts_.push_back(values_.size());
    values_.push_back(values[1]);
    values_.insert(values_.end(), values.begin(), values.end());
  }
}

HeatSeries::Row HeatSeries::row(int step, int sample) const {
  const auto i = static_cast<std::size_t>(step - first_ + sample);
  return {z_[i], counts_[i], values_.data() + starts_[i]};
}

}  // namespace weft::descriptor
