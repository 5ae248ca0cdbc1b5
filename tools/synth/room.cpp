#include "synth/room.hpp"

#include <algorithm>
#include <cmath>

namespace weft::synth {
namespace {

constexpr float kWall_m = 0.1f, kHeight_m = 3.2f;  // thickness and height of the walls

float fraction(float x) { return x - static_cast<float>(floor_int(x)); }

Vec3 random_colour(Random& r) {
  return colour_from_hsv(r.uniform(), r.uniform(0.1, 0.85), r.uniform(0.25, 0.95));
}

Vec3 cell_colour(int x, int y, std::uint32_t seed) {
  const auto share = [&](std::uint32_t k) { return static_cast<double>(hash01(x, y, seed + k)); };
  return colour_from_hsv(share(1), 0.15 + 0.75 * share(2), 0.2 + 0.75 * share(3));
}

struct Builder {
  Room& room;
  Random& r;

  float u(double low, double high) { return static_cast<float>(r.uniform(low, high)); }
  int paint(Paint p) {
    p.seed = static_cast<std::uint32_t>(r.bits());
    room.paints.push_back(p);
    return static_cast<int>(room.paints.size()) - 1;
  }
  int plain() {
    Paint p;
    p.base = random_colour(r);
    return paint(p);
  }
  int like_a_table(std::initializer_list<const char*> families) {
    Paint p;
    p.kind = Paint::Kind::kTable;
    // Families that are rare are drawn often enough to come up within a few dozen draws.
    do {
      p.table = draw_table(r);
    } while (std::find(families.begin(), families.end(), p.table.family) == families.end());
    return paint(p);
  }
  void add(const Prism& prism, int paint_index, float step = 0.12f, bool is_desk = false) {
    room.solids.push_back({prism, paint_index, is_desk, step});
  }

  void desk(int kind) {
    const float thick = u(0.022, 0.045), floor = room.floor_m;
    const Vec2 size = kind == 2 ? Vec2::Constant(u(1.15, 1.5)) : Vec2(u(1.3, 1.9), u(0.75, 1.05));
    const float turn = u(-0.2, 0.2);
    const auto s = static_cast<float>(sine(static_cast<double>(turn)));
    const auto c = static_cast<float>(cosine(static_cast<double>(turn)));
    const auto place = [&](float x, float y) { return Vec2(c * x - s * y, s * x + c * y); };
    const auto box = [&](float x, float y, float w, float d, float low, float high, int p,
                         float step) {
      add(make_box(place(x, y), {w, d}, low, high, s, c), p, step, true);
    };
    const int top = like_a_table({"grey", "white", "planks", "wood", "dark"});
    const int frame = r.uniform() < 0.5 ? top : plain();
    room.desk_top = kind == 2 ? make_cylinder(Vec2::Zero(), 0.5f * size.x(), -thick, 0.0f)
                              : make_box(Vec2::Zero(), size, -thick, 0.0f, s, c);
    add(room.desk_top, top, 0.009f, true);
    const float x = 0.5f * size.x() - 0.06f, y = 0.5f * size.y() - 0.06f, leg = u(0.045, 0.08);
    if (kind == 0 || kind == 3) {
      for (const float i : {-1.0f, 1.0f}) {
        for (const float j : {-1.0f, 1.0f}) box(i * x, j * y, leg, leg, floor, -thick, frame, 0.1f);
      }
    }
    if (kind == 0) {
      for (const float j : {-1.0f, 1.0f})
        box(0.0f, j * y, 2 * x, 0.025f, -thick - 0.08f, -thick, frame, 0.1f);
    } else if (kind == 1) {
      for (const float i : {-1.0f, 1.0f})
        box(i * x, 0.0f, 0.035f, 2 * y, floor, -thick, frame, 0.1f);
      box(0.0f, -0.6f * y, 2 * x, 0.03f, -0.45f, -thick, frame, 0.1f);
    } else if (kind == 2) {
      add(make_cylinder(Vec2::Zero(), 0.06f, floor + 0.03f, -thick), frame, 0.1f, true);
      add(make_cylinder(Vec2::Zero(), 0.3f * size.x(), floor, floor + 0.03f), frame, 0.1f, true);
    } else {
      const float width = u(0.35, 0.45);
      box(x - 0.5f * width, 0.0f, width, 1.9f * y, floor + 0.1f, -thick, frame, 0.1f);
      for (int k = 0; k < 3; ++k) {
        const float low = floor + 0.14f + 0.19f * static_cast<float>(k);
        box(x - 0.5f * width, -0.95f * y - 0.012f, 0.85f * width, 0.02f, low, low + 0.16f, top,
            0.1f);
      }
    }
  }

  /// A shelf with books against the wall; along: turn so that its back is at the wall.
  void shelf(const Vec2& centre, float s, float c) {
    const float width = u(0.9, 1.6), depth = 0.3f, height = u(1.5, 2.1), floor = room.floor_m;
    const int wood = like_a_table({"wood", "white", "planks", "grey"});
    const auto place = [&](float x, float y) {
      return Vec2(centre.x() + c * x - s * y, centre.y() + s * x + c * y);
    };
    const auto box = [&](float x, float y, float w, float d, float low, float high, int p) {
      add(make_box(place(x, y), {w, d}, floor + low, floor + high, s, c), p, 0.15f);
    };
    box(0.0f, 0.5f * depth - 0.01f, width, 0.02f, 0.0f, height, wood);
    for (const float i : {-0.5f, 0.5f}) box(i * width, 0.0f, 0.025f, depth, 0.0f, height, wood);
    const int boards = 4 + static_cast<int>(r.below(2));
    const float pitch = (height - 0.03f) / static_cast<float>(boards);
    for (int k = 0; k <= boards; ++k) {
      const float low = pitch * static_cast<float>(k);
      box(0.0f, 0.0f, width, depth, low, low + 0.025f, wood);
      if (k == boards) break;
      for (float x = -0.5f * width + 0.03f; x < 0.5f * width - 0.07f;) {
        const float w = u(0.02, 0.055), d = u(0.14, 0.24);
        if (r.uniform() < 0.12) {
          x += 2 * w;
          continue;
        }
        Paint cover;
        cover.kind = Paint::Kind::kPoster;
        cover.scale_m = u(0.02, 0.06);
        cover.base = random_colour(r);
        box(x + 0.5f * w, 0.5f * depth - 0.03f - 0.5f * d, w - 0.002f, d, low + 0.025f,
            low + 0.025f + std::min(pitch - 0.05f, u(0.17, 0.3)), paint(cover));
        x += w;
      }
    }
  }

  void walls() {
    const Vec2 h = room.half_size;
    const float floor = room.floor_m, top = floor + kHeight_m;
    add(make_box(Vec2::Zero(), 2 * h, floor - 0.1f, floor),
        like_a_table({"planks", "concrete", "cloth", "wood"}), 0.12f);
    Paint ceiling;
    ceiling.base = Vec3::Constant(0.75f);
    add(make_box(Vec2::Zero(), 2 * h, top, top + 0.1f), paint(ceiling), 0.5f);
    for (int side = 0; side < 4; ++side) {
      // The inner side is y = -half of a frame turned by quarter turns.
      const float s = side == 1 ? 1.0f : (side == 3 ? -1.0f : 0.0f);
      const float c = side == 0 ? 1.0f : (side == 2 ? -1.0f : 0.0f);
      const float away = side % 2 == 0 ? h.y() : h.x(), half = side % 2 == 0 ? h.x() : h.y();
      const auto place = [&](float x, float y) { return Vec2(c * x - s * y, s * x + c * y); };
      Paint wall;
      const double pick = r.uniform();
      wall.kind = pick < 0.35   ? Paint::Kind::kBrick
                  : pick < 0.75 ? Paint::Kind::kWallpaper
                                : Paint::Kind::kPlain;
      wall.base = colour_from_hsv(r.uniform(), r.uniform(0.05, 0.4), r.uniform(0.5, 0.9));
      wall.second = wall.base * u(0.4, 0.85);
      wall.third = random_colour(r);
      wall.scale_m = u(0.12, 0.3);
      add(make_box(place(0.0f, away + 0.5f * kWall_m), {2 * half, kWall_m}, floor, top, s, c),
          paint(wall), 0.2f);
      const int posters = 2 + static_cast<int>(r.below(3));
      for (int k = 0; k < posters; ++k) {
        Paint poster;
        poster.kind = Paint::Kind::kPoster;
        poster.base = random_colour(r);
        poster.scale_m = u(0.08, 0.2);
        const float w = u(0.4, 0.9), x = u(-0.85, 0.85) * (half - 0.5f * w), low = u(0.9, 1.4);
        const float d = 0.004f + 0.004f * static_cast<float>(k);
        add(make_box(place(x, away - 0.5f * d), {w, d}, floor + low, floor + low + u(0.5, 0.9), s,
                     c),
            paint(poster), 0.2f);
      }
      if (r.uniform() < 0.7) {
        const Vec2 p = place(u(-0.5, 0.5) * half, away - 0.16f);
        shelf(p, s, c);
      } else {
        for (int k = 0; k < 4; ++k) {
          Paint carton;
          carton.kind = Paint::Kind::kPoster;
          carton.base = colour_from_hsv(0.08, r.uniform(0.3, 0.6), r.uniform(0.5, 0.8));
          carton.scale_m = u(0.1, 0.2);
          const float size = u(0.3, 0.55);
          add(make_box(place(u(-0.8, 0.8) * half, away - 0.4f), {size, 0.8f * size}, floor,
                       floor + u(0.3, 1.0), s, c),
              paint(carton), 0.15f);
        }
      }
    }
  }
};

}  // namespace

std::vector<Prism> Room::desk() const {
  std::vector<Prism> out;
  for (const auto& s : solids) {
    if (s.is_desk) out.push_back(s.prism);
  }
  return out;
}

const Vec3& Room::desk_colour() const {
  const auto top =
      std::find_if(solids.begin(), solids.end(), [](const auto& s) { return s.is_desk; });
  return paints[static_cast<std::size_t>(top->paint)].table.base;
}

Room draw_room(Random& random, int kind) {
  Room room;
  Builder builder{room, random};
  static const char* const kNames[kDeskKinds] = {"four-legs", "panel-legs", "round", "drawers"};
  if (kind < 0) kind = static_cast<int>(random.below(kDeskKinds));
  room.desk_kind = kNames[kind];
  room.floor_m = builder.u(-0.8, -0.68);
  room.half_size = Vec2(builder.u(2.4, 3.0), builder.u(2.4, 3.0));
  builder.desk(kind);
  builder.walls();
  return room;
}

Vec3 Paint::albedo(const Vec2& p) const {
  const float fine = 0.92f + 0.16f * noise(p.x() / 0.004f, p.y() / 0.004f, seed + 1);
  switch (kind) {
    case Kind::kTable:
      return table.albedo(p);
    case Kind::kBrick: {
      const float height = 0.35f * scale_m;
      const int row = floor_int(p.y() / height);
      const float x = p.x() / scale_m + ((row & 1) != 0 ? 0.5f : 0.0f);
      const int column = floor_int(x);
      const bool joint = fraction(p.y() / height) * height < 0.01f || fraction(x) * scale_m < 0.01f;
      if (joint) return second * fine;
      return (base * (0.65f + 0.5f * hash01(column, row, seed + 2)) *
              (0.7f + 0.6f * fractal_noise(p.x() / 0.05f, p.y() / 0.05f, 3, seed + 3)))
          .cwiseMin(0.9f);
    }
    case Kind::kWallpaper: {
      const int x = floor_int(p.x() / scale_m), y = floor_int(p.y() / scale_m);
      const Vec2 d(fraction(p.x() / scale_m) - 0.3f - 0.4f * hash01(x, y, seed + 2),
                   fraction(p.y() / scale_m) - 0.3f - 0.4f * hash01(x, y, seed + 3));
      const float petals =
          0.12f + 0.22f * noise(9.0f * d.x() + static_cast<float>(x) * 7.1f,
                                9.0f * d.y() + static_cast<float>(y) * 3.3f, seed + 4);
      const float radius = d.norm();
      Vec3 c = radius < petals ? (radius < 0.4f * petals ? third : second) : base;
      return (c * fine).cwiseMin(0.9f);
    }
    case Kind::kPoster: {
      const int x = floor_int(p.x() / scale_m), y = floor_int(p.y() / scale_m);
      const Vec2 d(fraction(p.x() / scale_m), fraction(p.y() / scale_m));
      const float shape = hash01(x, y, seed + 4);
      if (shape < 0.3f) {  // letters
        const int row = floor_int(d.y() * 7.0f), column = floor_int(d.x() * 16.0f);
        const bool ink = (row & 1) != 0 && hash01(x * 16 + column, y * 7 + row, seed + 5) < 0.6f;
        return (ink ? cell_colour(x, y, seed + 20) * 0.3f : base) * fine;
      }
      const Vec3 own = cell_colour(x, y, seed + 6);
      bool on = false;
      if (shape < 0.5f) {
        on = (d - Vec2(0.5f, 0.5f)).norm() < 0.2f + 0.25f * hash01(x, y, seed + 7);
      } else if (shape < 0.75f) {
        on = hash01(x, y, seed + 8) < 0.5f ? d.x() > d.y() : d.x() + d.y() < 1.0f;
      } else {
        on = d.x() > 0.2f && d.x() < 0.8f && d.y() > 0.25f && d.y() < 0.6f;
      }
      return (on ? own : cell_colour(x, y, seed + 9)) * fine;
    }
    case Kind::kPlain:
      return (base * (0.85f + 0.3f * fractal_noise(p.x() / 0.15f, p.y() / 0.15f, 3, seed + 2)))
          .cwiseMin(0.9f);
  }
  return base;
}

}  // namespace weft::synth
