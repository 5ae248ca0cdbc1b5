#include "synth/light.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace weft::synth {
namespace {

constexpr float kOffset = 0.0008f;  // shadow rays start this far off the surface

Vec3 white(Random& r, double spread) {
  // From warm bulb to cold tube, and a little green or magenta as cheap tubes have it.
  const auto warm = static_cast<float>(r.uniform(-spread, spread));
  const auto green = static_cast<float>(r.uniform(-0.25 * spread, 0.25 * spread));
  return {1.0f + warm, 1.0f + green, 1.0f - warm};
}

}  // namespace

const std::array<Vec3, kSkyDirections>& sky_directions() {
  static const auto directions = [] {
    std::array<Vec3, kSkyDirections> out;
    for (int i = 0; i < kSkyDirections; ++i) {  // Fibonacci spiral, cosine weighted
      const double sin2 = (i + 0.5) / kSkyDirections;
      const double radius = std::sqrt(sin2), angle = 2.399963229728653 * i;
      out[static_cast<std::size_t>(i)] =
          Vec3(static_cast<float>(radius * cosine(angle)), static_cast<float>(radius * sine(angle)),
               static_cast<float>(std::sqrt(1.0 - sin2)));
    }
    return out;
  }();
  return directions;
}

SkyMask sky_mask(const RayScene& scene, const Vec3& point, const Vec3& normal) {
  SkyMask mask = 0;
  const auto& directions = sky_directions();
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const float side = normal.dot(directions[i]) >= 0.0f ? kOffset : -kOffset;
    if (scene.occluded(point + side * normal, directions[i], 0.0f, 3.0f)) mask |= SkyMask{1} << i;
  }
  return mask;
}

Lighting draw_lighting(Random& r, const Vec3& camera) {
  Lighting l;
  const auto u = [&](double a, double b) { return static_cast<float>(r.uniform(a, b)); };
  const auto area = [&](const Vec3& centre, const Vec3& a, const Vec3& b, int na, int nb,
                        const Vec3& power) {
    for (int i = 0; i < na; ++i) {
      for (int j = 0; j < nb; ++j) {
        const Vec3 p = centre +
                       a * ((2.0f * static_cast<float>(i) + 1.0f) / static_cast<float>(na) - 1.0f) +
                       b * ((2.0f * static_cast<float>(j) + 1.0f) / static_cast<float>(nb) - 1.0f);
        l.points.push_back({p, power / static_cast<float>(na * nb)});
      }
    }
  };
  const float ambient = r.uniform() < 0.5 ? u(0.06, 0.25) : u(0.2, 0.55);
  l.sky_base = white(r, 0.12) * ambient;
  l.sky_slope = Vec3(u(-0.6, 0.6), u(-0.6, 0.6), u(0.0, 0.4));
  l.bounce = u(0.15, 0.45);
  const int tubes = static_cast<int>(r.integer(1, 2));
  for (int i = 0; i < tubes; ++i) {
    const float height = u(1.3, 2.4);
    const double angle = r.uniform(0.0, kPi);
    const Vec3 along(static_cast<float>(cosine(angle)), static_cast<float>(sine(angle)), 0.0f);
    area(Vec3(u(-1.2, 1.2), u(-1.2, 1.2), height), along * u(0.3, 0.75), Vec3::Zero(), 12, 1,
         white(r, 0.1) * (height * height * u(0.4, 1.0) / static_cast<float>(tubes)));
  }
  const double extra = r.uniform();
  if (extra < 0.3) {  // window at the side
    const double angle = r.uniform(0.0, 2 * kPi);
    const Vec3 out(static_cast<float>(cosine(angle)), static_cast<float>(sine(angle)), 0.0f);
    const Vec3 centre = out * u(1.2, 2.5) + Vec3(0, 0, u(0.5, 1.4));
    area(centre, out.cross(Vec3(0, 0, 1)) * u(0.3, 0.8), Vec3(0, 0, u(0.2, 0.45)), 4, 3,
         white(r, 0.12) * (centre.squaredNorm() * u(0.4, 1.6)));
  } else if (extra < 0.6) {  // lamp beside the camera: the hot spot of CTU
    const Vec3 centre = camera + Vec3(u(-0.35, 0.35), u(-0.35, 0.35), u(-0.1, 0.3));
    area(centre, Vec3(0.05f, 0, 0), Vec3(0, 0.05f, 0), 3, 3,
         white(r, 0.12) * (centre.z() * centre.z() * u(0.2, 1.2)));
  } else if (extra < 0.7) {  // small hard lamp from the side
    const double angle = r.uniform(0.0, 2 * kPi);
    const Vec3 centre(static_cast<float>(cosine(angle)) * u(0.5, 1.0),
                      static_cast<float>(sine(angle)) * u(0.5, 1.0), u(0.5, 1.1));
    area(centre, Vec3(0.04f, 0, 0), Vec3(0, 0.04f, 0), 3, 3,
         white(r, 0.2) * (centre.squaredNorm() * u(0.3, 1.2)));
  }
  return l;
}

Irradiance irradiance(const Lighting& l, const RayScene& scene, const Vec3& point,
                      const Vec3& normal, SkyMask blocked, bool cast_shadows) {
  Irradiance e;
  const auto& directions = sky_directions();
  // The directions are cosine weighted about the vertical: each stands for pi / n of cosine-solid
  // angle, or pi / (n cos) of solid angle. The irradiance is kept over pi.
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Vec3& d = directions[i];
    const float cosine_normal = normal.dot(d);
    const int side = cosine_normal >= 0.0f ? 0 : 1;
    const float weight = 1.0f / (static_cast<float>(kSkyDirections) * std::max(0.12f, d.z()));
    Vec3 radiance = l.sky_base * std::max(0.0f, 1.0f + l.sky_slope.dot(d));
    if ((blocked >> i & 1) != 0) radiance *= l.bounce;
    e.value[side] += radiance * (weight * std::abs(cosine_normal));
    e.slope[side] += d * (luminance(radiance) * weight);
  }
  // The table and other cloth below throw a little light back.
  for (int side = 0; side < 2; ++side) {
    const float down = 0.5f * (1.0f - (side == 0 ? normal.z() : -normal.z()));
    e.value[side] += l.sky_base * (0.4f * l.bounce * down);
  }
  for (const auto& light : l.points) {
    const Vec3 way = light.position - point;
    const float r2 = way.squaredNorm(), r = std::sqrt(r2);
    const Vec3 d = way / r;
    const float cosine_normal = normal.dot(d);
    const int side = cosine_normal >= 0.0f ? 0 : 1;
    if (cast_shadows &&
        scene.occluded(point + (side == 0 ? kOffset : -kOffset) * normal, d, 0.0f, r)) {
      continue;
    }
    const Vec3 radiance = light.power / r2;
    e.value[side] += radiance * std::abs(cosine_normal);
    e.slope[side] += d * luminance(radiance);
  }
  return e;
}

Vec3 table_gloss(const Lighting& l, const Vec3& point, const Vec3& camera, float exponent) {
  const Vec3 view = (camera - point).normalized();
  Vec3 sum = Vec3::Zero();
  for (const auto& light : l.points) {
    const Vec3 way = light.position - point;
    const float r2 = way.squaredNorm();
    const Vec3 half = (way / std::sqrt(r2) + view).normalized();
    sum += light.power / r2 * static_cast<float>(power(half.z(), 4.0 * exponent));
  }
  return sum * (0.125f * (exponent + 2.0f));
}

}  // namespace weft::synth
