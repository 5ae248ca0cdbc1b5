#include "synth/table.hpp"

#include <algorithm>
#include <cmath>

namespace weft::synth {

Table draw_table(Random& r) {
  Table t;
  t.seed = static_cast<std::uint32_t>(r.bits());
  constexpr std::pair<const char*, double> kFamilies[] = {
      {"grey", 0.26},     {"white", 0.22}, {"planks", 0.27}, {"wood", 0.08},
      {"concrete", 0.06}, {"cloth", 0.05}, {"dark", 0.06}};
  double pick = r.uniform();
  for (const auto& [name, share] : kFamilies) {
    t.family = name;
    if ((pick -= share) < 0.0) break;
  }
  const auto u = [&](double a, double b) { return static_cast<float>(r.uniform(a, b)); };
  t.speckle = u(0.0, 0.06);
  t.grain = u(0.0, 0.08);
  t.gloss = r.uniform() < 0.5 ? u(0.0, 0.03) : u(0.03, 0.25);
  t.gloss_exponent = static_cast<float>(power(10.0, r.uniform(0.7, 2.2)));
  // The narrower a highlight, the brighter: few tables are such mirrors.
  if (r.uniform() < 0.8) t.gloss = std::min(t.gloss, 2.5f / (t.gloss_exponent + 2.0f));
  if (t.family == "grey") {
    t.base = colour_from_hsv(r.uniform(), r.uniform(0.0, 0.1), r.uniform(0.35, 0.75));
  } else if (t.family == "white") {
    t.base = colour_from_hsv(r.uniform(0.0, 0.2), r.uniform(0.0, 0.1), r.uniform(0.82, 0.97));
  } else if (t.family == "planks" || t.family == "wood") {
    t.base = colour_from_hsv(r.uniform(0.05, 0.12), r.uniform(0.08, 0.5), r.uniform(0.4, 0.9));
    t.grain = u(0.15, 0.7);
    t.plank_width_m = u(0.06, 0.2);
    t.plank_length_m = u(0.4, 1.4);
    t.gap_width_m = u(0.0006, 0.0025);
  } else if (t.family == "concrete") {
    t.base = colour_from_hsv(r.uniform(0.0, 0.2), r.uniform(0.0, 0.15), r.uniform(0.3, 0.75));
    t.grain = u(0.1, 0.4);
    t.speckle = u(0.05, 0.3);
  } else if (t.family == "cloth") {
    t.base = colour_from_hsv(r.uniform(), r.uniform(0.0, 0.7), r.uniform(0.2, 0.95));
    t.speckle = u(0.05, 0.25);
    t.gloss = 0.0f;
  } else {
    t.base = colour_from_hsv(r.uniform(), r.uniform(0.0, 0.3), r.uniform(0.08, 0.3));
  }
  t.second = t.base * u(0.45, 0.9);
  t.gap = t.base * u(0.08, 0.5);
  const double angle = r.uniform(0.0, 2 * kPi);
  t.sine = static_cast<float>(sine(angle));
  t.cosine = static_cast<float>(cosine(angle));
  if (r.uniform() < 0.15) {
    t.half_size = Vec2(u(0.5, 1.0), u(0.4, 0.7));
    t.centre = Vec2(u(-0.15, 0.15), u(-0.1, 0.1));
    const double turn = r.uniform(0.0, 2 * kPi);
    t.edge_sine = static_cast<float>(sine(turn));
    t.edge_cosine = static_cast<float>(cosine(turn));
  }
  t.floor_m = u(-0.85, -0.6);
  t.floor = colour_from_hsv(r.uniform(), r.uniform(0.0, 0.3), r.uniform(0.1, 0.7));
  for (int i = 1; i < 3; ++i) t.warp[i] = u(-0.004, 0.004);
  for (int i = 3; i < 6; ++i) t.warp[i] = u(-0.006, 0.006);
  return t;
}

bool Table::on_table(const Vec2& p) const {
  const Vec2 d = p - centre;
  return std::abs(edge_cosine * d.x() + edge_sine * d.y()) < half_size.x() &&
         std::abs(-edge_sine * d.x() + edge_cosine * d.y()) < half_size.y();
}

float Table::height_m(const Vec2& p) const {
  const float x = std::clamp(p.x(), -1.5f, 1.5f), y = std::clamp(p.y(), -1.5f, 1.5f);
  return warp[0] + warp[1] * x + warp[2] * y + warp[3] * x * x + warp[4] * x * y + warp[5] * y * y;
}

Vec3 Table::albedo(const Vec2& p) const {
  const float fine = 1.0f + speckle * (noise(p.x() / 0.0015f, p.y() / 0.0015f, seed + 1) +
                                       noise(p.x() / 0.004f, p.y() / 0.004f, seed + 2) - 1.0f);
  if (family != "planks" && family != "wood") {
    const float slow =
        1.0f + grain * (2.0f * fractal_noise(p.x() / 0.08f, p.y() / 0.08f, 4, seed + 3) - 1.0f);
    return (base * (fine * slow)).cwiseMin(0.93f);
  }
  float x = cosine * p.x() + sine * p.y(), y = -sine * p.x() + cosine * p.y();
  int row = 0, column = 0;
  bool in_gap = false;
  if (family == "planks") {
    row = floor_int(y / plank_width_m);
    y -= static_cast<float>(row) * plank_width_m;
    x += plank_length_m * 7.0f * hash01(row, 0, seed + 4);
    column = floor_int(x / plank_length_m);
    x -= static_cast<float>(column) * plank_length_m;
    in_gap = y < gap_width_m || x < gap_width_m;
  }
  const auto own =
      hash(static_cast<std::uint32_t>(row), static_cast<std::uint32_t>(column), seed + 5);
  const float tone = 0.78f + 0.44f * static_cast<float>(own >> 8) * 0x1.0p-24f;
  // Growth rings cut lengthwise: long nested arcs, and fine pores along the fibre.
  const float bend = fractal_noise(x / 0.35f, y / 0.07f, 2, own + 6);
  const float ring = (y / 0.02f + 5.0f * bend);
  const float in_ring = ring - static_cast<float>(floor_int(ring));
  const float arcs = in_ring * in_ring;
  const float pores = noise(x / 0.03f, y / 0.0012f, own + 7);
  const float mixing = clamp01(grain * (0.75f * arcs + 0.6f * pores - 0.2f + 0.5f * (bend - 0.5f)));
  Vec3 c = (base + (second - base) * mixing) * (tone * fine);
  if (in_gap) c = gap;
  return c.cwiseMin(0.93f);
}

Vec3 Table::floor_albedo(const Vec2& p) const {
  return (floor * (0.7f + 0.6f * fractal_noise(p.x() / 0.05f, p.y() / 0.05f, 3, seed + 8)))
      .cwiseMin(0.9f);
}

}  // namespace weft::synth
