#pragma once

#include <array>
#include <vector>

#include "base/random.hpp"
#include "synth/ray_scene.hpp"

/// Light that reaches surfaces. Every light is a fixed set of directions or points, the same for
/// every vertex, so shading is smooth: no random samples, no renderer's noise.
namespace weft::synth {

constexpr int kSkyDirections = 48;

/// Directions spread evenly over the upper half sphere.
const std::array<Vec3, kSkyDirections>& sky_directions();

/// Bit i: sky direction i is blocked at the point. normal: of the surface; the face turned to a
/// direction is the one asked about.
using SkyMask = std::uint64_t;
SkyMask sky_mask(const RayScene& scene, const Vec3& point, const Vec3& normal);

struct LightPoint {
  Vec3 position, power;  // irradiance at one metre
};

struct Lighting {
  Vec3 sky_base = Vec3::Zero();    // radiance of the surroundings, mean
  Vec3 sky_slope = Vec3::Zero();   // relative change along x, y, z
  std::vector<LightPoint> points;  // samples of tubes, lamps and windows
  float bounce = 0.3f;             // radiance of blocked directions relative to the sky
};

/// Direct light and hot spots; camera: its position, near which some lamps are.
Lighting draw_lighting(Random& random, const Vec3& camera);

/// Light at a point of a two-sided surface: [0] outside, [1] inside.
// clang-tidy finds the names that the compiler gives to its own copying of the arrays.
struct Irradiance {                              // NOLINT(bugprone-reserved-identifier)
  Vec3 value[2] = {Vec3::Zero(), Vec3::Zero()};  // over pi, so that albedo x value is radiance
  Vec3 slope[2] = {Vec3::Zero(), Vec3::Zero()};  // of its luminance with the normal
  Irradiance& operator+=(const Irradiance& o) {
    for (int s = 0; s < 2; ++s) {
      value[s] += o.value[s];
      slope[s] += o.slope[s];
    }
    return *this;
  }
  Irradiance& operator*=(float k) {
    for (int s = 0; s < 2; ++s) {
      value[s] *= k;
      slope[s] *= k;
    }
    return *this;
  }
};

/// blocked: of the sky; shadows of the light points are cast here if asked for.
Irradiance irradiance(const Lighting& lighting, const RayScene& scene, const Vec3& point,
                      const Vec3& normal, SkyMask blocked, bool cast_shadows);

/// Mirror-like reflection of the light points towards the camera by a flat table (Blinn 1977).
Vec3 table_gloss(const Lighting& lighting, const Vec3& point, const Vec3& camera, float exponent);

}  // namespace weft::synth
