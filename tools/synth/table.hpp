#pragma once

#include <string>

#include "base/random.hpp"
#include "synth/maths.hpp"

namespace weft::synth {

/// What the garment lies on: a rectangle at z = 0 that is not quite flat, a floor below it.
struct Table {
  std::string family;  // grey, white, planks, wood, concrete, cloth, dark
  std::uint32_t seed = 0;
  Vec3 base, second, gap;
  float plank_width_m = 0.1f, plank_length_m = 0.8f, gap_width_m = 0.001f;
  float grain = 0.0f;                // strength of wood grain or of mottling
  float speckle = 0.0f;              // strength of fine irregularity
  float sine = 0.0f, cosine = 1.0f;  // direction of planks
  Vec2 half_size = Vec2::Constant(5.0f), centre = Vec2::Zero();
  float edge_sine = 0.0f, edge_cosine = 1.0f;
  float floor_m = -0.72f;  // height of the floor
  Vec3 floor;
  float warp[6] = {};  // m: of 1, x, y, x^2, xy, y^2 (x, y in metres)
  float gloss = 0.0f, gloss_exponent = 20.0f;

  Vec3 albedo(const Vec2& p) const;
  Vec3 floor_albedo(const Vec2& p) const;
  bool on_table(const Vec2& p) const;
  float height_m(const Vec2& p) const;  // of the table top
};

Table draw_table(Random& random);

}  // namespace weft::synth
