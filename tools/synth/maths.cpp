#include "synth/maths.hpp"

#include <algorithm>

namespace weft::synth {

double sine(double x) {
  const double turns = x / (2 * kPi);
  x -= 2 * kPi * static_cast<double>(static_cast<long long>(turns + (turns < 0 ? -0.5 : 0.5)));
  if (x > kPi / 2) x = kPi - x;
  if (x < -kPi / 2) x = -kPi - x;
  const double x2 = x * x;
  double term = x, sum = x;
  for (int n = 1; n < 10; ++n) {
    term *= -x2 / ((2 * n) * (2 * n + 1));
    sum += term;
  }
  return sum;
}

Vec3 colour_from_hsv(double hue, double saturation, double value) {
  Vec3 rgb;
  for (int c = 0; c < 3; ++c) {
    double k = hue * 6.0 + (c == 0 ? 5.0 : c == 1 ? 3.0 : 1.0);
    while (k >= 6.0) k -= 6.0;
    while (k < 0.0) k += 6.0;
    const double shown = value * (1.0 - saturation * std::clamp(std::min(k, 4.0 - k), 0.0, 1.0));
    rgb[c] = static_cast<float>(power(shown, 2.2));
  }
  return rgb;
}

float noise(float x, float y, std::uint32_t seed) {
  const int ix = floor_int(x), iy = floor_int(y);
  float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
  fx = fx * fx * (3.0f - 2.0f * fx);
  fy = fy * fy * (3.0f - 2.0f * fy);
  const float a = hash01(ix, iy, seed), b = hash01(ix + 1, iy, seed);
  const float c = hash01(ix, iy + 1, seed), d = hash01(ix + 1, iy + 1, seed);
  return (a + (b - a) * fx) * (1.0f - fy) + (c + (d - c) * fx) * fy;
}

float fractal_noise(float x, float y, int octaves, std::uint32_t seed) {
  float sum = 0.0f, weight = 1.0f, total = 0.0f;
  for (int i = 0; i < octaves; ++i) {
    sum += weight * noise(x, y, seed + static_cast<std::uint32_t>(i) * 101u);
    total += weight;
    weight *= 0.5f;
    x = x * 2.0f + 17.3f;
    y = y * 2.0f - 5.7f;
  }
  return sum / total;
}

}  // namespace weft::synth
