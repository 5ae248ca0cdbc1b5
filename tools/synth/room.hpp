#pragma once

#include <string>
#include <vector>

#include "synth/prism.hpp"
#include "synth/table.hpp"

/// A desk in a furnished room: what a robot sees that drives round the T-shirts.
namespace weft::synth {

struct Paint {
  enum class Kind { kTable, kBrick, kWallpaper, kPoster, kPlain } kind = Kind::kPlain;
  std::uint32_t seed = 0;
  Table table;  // of kTable
  Vec3 base = Vec3::Constant(0.5f), second = Vec3::Constant(0.3f), third = Vec3::Constant(0.7f);
  float scale_m = 0.1f;

  /// Linear RGB. uv: metres on the face.
  Vec3 albedo(const Vec2& uv) const;
};

struct Solid {
  Prism prism;
  int paint = 0;
  bool is_desk = false;
  float light_step_m = 0.1f;  // spacing of the vertices that carry light
};

struct Room {
  std::string desk_kind;          // four-legs, panel-legs, round, drawers
  Prism desk_top;                 // its upper face is at z = 0
  float floor_m = -0.74f;         // height of the floor
  Vec2 half_size = Vec2::Zero();  // of the floor, the desk in the middle
  std::vector<Solid> solids;      // with the desk
  std::vector<Paint> paints;

  std::vector<Prism> desk() const;
  const Vec3& desk_colour() const;
};

constexpr int kDeskKinds = 4;

/// kind: 0 to kDeskKinds - 1, or -1 to draw it.
Room draw_room(Random& random, int desk_kind = -1);

}  // namespace weft::synth
