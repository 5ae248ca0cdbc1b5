#include "synth/prism.hpp"

#include <algorithm>
#include <cmath>

namespace weft::synth {
namespace {

constexpr int kCorners = 48;

float cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

struct Grid {
  Surface& surface;
  std::uint8_t face;
  Vec3 normal;

  int vertex(const Vec3& position, const Vec2& uv) {
    surface.position.push_back(position);
    surface.normal.push_back(normal);
    surface.pattern.push_back(uv);
    return static_cast<int>(surface.position.size()) - 1;
  }
  void triangle(int a, int b, int c) {
    surface.faces.push_back({a, b, c});
    surface.panel_of_face.push_back(face);
  }
  /// (columns + 1) x (rows + 1) vertices from `first` on, counter-clockwise along columns then
  /// rows.
  void quads(int first, int columns, int rows) {
    for (int j = 0; j < rows; ++j) {
      for (int i = 0; i < columns; ++i) {
        const int a = first + j * (columns + 1) + i, b = a + 1, c = b + columns + 1, d = c - 1;
        triangle(a, b, c);
        triangle(a, c, d);
      }
    }
  }
};

int steps(float length, float step) {
  return std::max(1, static_cast<int>(std::ceil(length / step)));
}

/// Top or bottom of a parallelogram.
void add_lid(Grid grid, const std::vector<Vec2>& o, float z, bool up, float step) {
  const Vec2 a = o[1] - o[0], b = o[3] - o[0];
  const int columns = steps(a.norm(), step), rows = steps(b.norm(), step);
  const int first = static_cast<int>(grid.surface.position.size());
  for (int j = 0; j <= rows; ++j) {
    for (int i = 0; i <= columns; ++i) {
      const float s = static_cast<float>(i) / static_cast<float>(columns);
      const float t = static_cast<float>(j) / static_cast<float>(rows);
      const Vec2 p = o[0] + s * a + t * b;
      grid.vertex({p.x(), p.y(), z}, {s * a.norm(), t * b.norm()});
    }
  }
  const std::size_t before = grid.surface.faces.size();
  grid.quads(first, columns, rows);
  if (up) return;
  for (std::size_t f = before; f < grid.surface.faces.size(); ++f) {
    std::swap(grid.surface.faces[f][1], grid.surface.faces[f][2]);
  }
}

/// Top or bottom of any convex outline: rings about the middle.
void add_disc(Grid grid, const std::vector<Vec2>& corners, float z, bool up, float step) {
  Vec2 middle = Vec2::Zero();
  for (const auto& p : corners) middle += p / static_cast<float>(corners.size());
  std::vector<Vec2> o;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const Vec2 edge = corners[(k + 1) % corners.size()] - corners[k];
    const int pieces = steps(edge.norm(), step);
    for (int i = 0; i < pieces; ++i) {
      o.push_back(corners[k] + edge * (static_cast<float>(i) / static_cast<float>(pieces)));
    }
  }
  const int n = static_cast<int>(o.size()), rings = steps((o[0] - middle).norm(), step);
  const int centre = grid.vertex({middle.x(), middle.y(), z}, Vec2::Zero());
  for (int r = 1; r <= rings; ++r) {
    for (const auto& corner : o) {
      const Vec2 d = (corner - middle) * (static_cast<float>(r) / static_cast<float>(rings));
      grid.vertex({middle.x() + d.x(), middle.y() + d.y(), z}, d);
    }
  }
  const auto add = [&](int a, int b, int c) {
    up ? grid.triangle(a, b, c) : grid.triangle(a, c, b);
  };
  for (int i = 0; i < n; ++i) {
    const int k = (i + 1) % n;
    add(centre, centre + 1 + i, centre + 1 + k);
    for (int r = 1; r < rings; ++r) {
      const int inner = centre + 1 + (r - 1) * n, outer = inner + n;
      add(inner + i, outer + i, outer + k);
      add(inner + i, outer + k, inner + k);
    }
  }
}

}  // namespace

Prism make_box(const Vec2& centre, const Vec2& size, float low, float high, float sine,
               float cosine) {
  Prism prism{{}, low, high};
  for (const auto& [x, y] : {std::pair(-0.5f, -0.5f), {0.5f, -0.5f}, {0.5f, 0.5f}, {-0.5f, 0.5f}}) {
    const float dx = x * size.x(), dy = y * size.y();
    prism.outline.push_back(centre + Vec2(cosine * dx - sine * dy, sine * dx + cosine * dy));
  }
  return prism;
}

Prism make_cylinder(const Vec2& centre, float radius, float low, float high) {
  Prism prism{{}, low, high};
  for (int i = 0; i < kCorners; ++i) {
    const double angle = 2 * kPi * i / kCorners;
    prism.outline.push_back(
        centre + radius * Vec2(static_cast<float>(cosine(angle)), static_cast<float>(sine(angle))));
  }
  return prism;
}

float signed_distance(const Prism& prism, const Vec3& point) {
  const Vec2 p = point.head<2>();
  float nearest = 1e30f, deepest = -1e30f;
  const auto& o = prism.outline;
  for (std::size_t i = 0; i < o.size(); ++i) {
    const Vec2 edge = o[(i + 1) % o.size()] - o[i], d = p - o[i];
    const float t = std::clamp(d.dot(edge) / edge.squaredNorm(), 0.0f, 1.0f);
    nearest = std::min(nearest, (d - t * edge).norm());
    deepest = std::max(deepest, -cross(edge, d) / edge.norm());
  }
  const float in_plane = deepest <= 0.0f ? deepest : nearest;
  const float upright = std::max(prism.low_m - point.z(), point.z() - prism.high_m);
  if (in_plane <= 0.0f || upright <= 0.0f) return std::max(in_plane, upright);
  return std::sqrt(in_plane * in_plane + upright * upright);
}

bool contains(const Prism& prism, const Vec2& p) {
  const auto& o = prism.outline;
  for (std::size_t i = 0; i < o.size(); ++i) {
    if (cross(o[(i + 1) % o.size()] - o[i], p - o[i]) < 0.0f) return false;
  }
  return true;
}

Surface tessellate(const Prism& prism, float step) {
  Surface s;
  const auto& o = prism.outline;
  const float height = prism.high_m - prism.low_m;
  for (std::size_t k = 0; k < o.size(); ++k) {
    const Vec2 edge = o[(k + 1) % o.size()] - o[k];
    const float length = edge.norm();
    Grid grid{s, static_cast<std::uint8_t>(k), Vec3(edge.y(), -edge.x(), 0.0f) / length};
    const int columns = steps(length, step), rows = steps(height, step);
    const int first = static_cast<int>(s.position.size());
    for (int j = 0; j <= rows; ++j) {
      for (int i = 0; i <= columns; ++i) {
        const float a = static_cast<float>(i) / static_cast<float>(columns);
        const float b = height * static_cast<float>(j) / static_cast<float>(rows);
        const Vec2 p = o[k] + a * edge;
        grid.vertex({p.x(), p.y(), prism.low_m + b}, {a * length, b});
      }
    }
    grid.quads(first, columns, rows);
  }
  const auto sides = static_cast<std::uint8_t>(o.size());
  const Grid top{s, sides, Vec3(0, 0, 1)};
  const Grid bottom{s, static_cast<std::uint8_t>(sides + 1), Vec3(0, 0, -1)};
  const auto lid = o.size() == 4 ? add_lid : add_disc;
  lid(top, o, prism.high_m, true, step);
  lid(bottom, o, prism.low_m, false, step);
  return s;
}

}  // namespace weft::synth
