#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "base/det_math.hpp"

/// Small arithmetic of the renderer: repeatable noise and elementary functions without libm, whose
/// last bits differ between processors.
namespace weft::synth {

using Vec2 = Eigen::Vector2f;
using Vec3 = Eigen::Vector3f;

constexpr double kPi = 3.14159265358979323846;

/// Sine of an angle of a few turns, within 1e-12.
double sine(double x);
inline double cosine(double x) { return sine(x + kPi / 2); }
/// x^y for x >= 0
inline double power(double x, double y) { return x <= 0.0 ? 0.0 : det::exp(y * det::log(x)); }

/// Rec. 709 luminance of linear RGB.
inline float luminance(const Vec3& rgb) { return rgb.dot(Vec3(0.2126f, 0.7152f, 0.0722f)); }
/// Linear RGB of hue (turns), saturation and value, as displayed (sRGB encoded) values.
Vec3 colour_from_hsv(double hue, double saturation, double value);

inline std::uint32_t hash(std::uint32_t x, std::uint32_t y, std::uint32_t seed) {
  std::uint32_t h = seed * 0x9e3779b1u + x * 0x85ebca6bu;
  h = (h ^ (h >> 15)) * 0x2c1b3c6du + y * 0xc2b2ae35u;
  h = (h ^ (h >> 13)) * 0x297a2d39u;
  h = (h ^ (h >> 16)) * 0x45d9f3bu;
  return h ^ (h >> 15);
}
/// In [0, 1).
inline float hash01(int x, int y, std::uint32_t seed) {
  return static_cast<float>(
             hash(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), seed) >> 8) *
         0x1.0p-24f;
}
inline int floor_int(float x) {
  const int i = static_cast<int>(x);
  return i - (x < static_cast<float>(i) ? 1 : 0);
}
inline float clamp01(float x) { return x < 0.0f ? 0.0f : (x > 1.0f ? 1.0f : x); }
/// 0 below `low`, 1 above `high`, smooth between.
inline float smooth_step(float low, float high, float x) {
  const float t = clamp01((x - low) / (high - low));
  return t * t * (3.0f - 2.0f * t);
}
/// Value noise with one cell a unit, in [0, 1].
float noise(float x, float y, std::uint32_t seed);
/// Sum of `octaves` noises, each twice as fine and half as strong; in [0, 1].
float fractal_noise(float x, float y, int octaves, std::uint32_t seed);

}  // namespace weft::synth
