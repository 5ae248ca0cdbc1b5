#include "synth/solid_mesh.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/error.hpp"
#include "base/text_file.hpp"

namespace weft::synth {
namespace {

constexpr std::size_t kMaxNodes = 200'000'000;

/// Corners of the six tetrahedra of a cell, as bits x, y, z; positively oriented.
constexpr int kTetrahedra[6][4] = {{0, 1, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7},
                                   {0, 3, 2, 7}, {0, 5, 1, 7}, {0, 6, 4, 7}};

float distance_to_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  // Ericson 2004, 5.1.5: the nearest feature by its Voronoi region.
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const float d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return ap.norm();
  const Vec3 bp = p - b;
  const float d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return bp.norm();
  const float vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (ap - ab * (d1 / (d1 - d3))).norm();
  const Vec3 cp = p - c;
  const float d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return cp.norm();
  const float vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (ap - ac * (d2 / (d2 - d6))).norm();
  const float va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0)
    return (bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))).norm();
  const Vec3 normal = ab.cross(ac);
  return std::abs(ap.dot(normal)) / std::max(normal.norm(), 1e-20f);
}

Field empty_field(const Vec3& low, const Vec3& high, float margin, float step) {
  Field f;
  f.step_m = step;
  f.origin = low - Vec3::Constant(margin + 2 * step);
  std::size_t count = 1;
  for (int i = 0; i < 3; ++i) {
    const float span = (high[i] - low[i] + 2 * margin) / step;
    if (!(span < 5000.0f)) throw Error("solid mesh: too large for its grid; take a larger step");
    f.nodes[static_cast<std::size_t>(i)] = static_cast<int>(span) + 6;
    count *= static_cast<std::size_t>(f.nodes[static_cast<std::size_t>(i)]);
  }
  if (count > kMaxNodes) throw Error("solid mesh: too large for its grid; take a larger step");
  f.value.assign(count, 2 * step);
  return f;
}

/// Nodes outside that no way along edges of tetrahedra joins to the border become inside.
void fill_hollows(Field& f) {
  std::vector<char> outside(f.value.size(), 0);
  std::vector<std::array<int, 3>> stack = {{0, 0, 0}};
  outside[0] = 1;
  while (!stack.empty()) {
    const auto [x, y, z] = stack.back();
    stack.pop_back();
    for (int way = 1; way < 8; ++way) {
      for (const int sign : {-1, 1}) {
        const int a = x + sign * (way & 1), b = y + sign * (way >> 1 & 1),
                  c = z + sign * (way >> 2);
        if (a < 0 || b < 0 || c < 0 || a >= f.nodes[0] || b >= f.nodes[1] || c >= f.nodes[2])
          continue;
        const std::size_t k = f.index(a, b, c);
        if (outside[k] != 0 || f.value[k] < 0) continue;
        outside[k] = 1;
        stack.push_back({a, b, c});
      }
    }
  }
  for (std::size_t k = 0; k < f.value.size(); ++k) {
    if (outside[k] == 0 && f.value[k] >= 0) f.value[k] = -0.5f * f.step_m;
  }
}

}  // namespace

std::size_t Field::index(int x, int y, int z) const {
  return (static_cast<std::size_t>(z) * static_cast<std::size_t>(nodes[1]) +
          static_cast<std::size_t>(y)) *
             static_cast<std::size_t>(nodes[0]) +
         static_cast<std::size_t>(x);
}

SolidMesh zero_surface(Field f) {
  fill_hollows(f);
  SolidMesh mesh;
  std::unordered_map<std::uint64_t, int> vertices;  // by edge: lower node and direction
  for (int z = 0; z + 1 < f.nodes[2]; ++z) {
    for (int y = 0; y + 1 < f.nodes[1]; ++y) {
      for (int x = 0; x + 1 < f.nodes[0]; ++x) {
        float value[8];
        int negative = 0;
        for (int c = 0; c < 8; ++c) {
          value[c] = f.value[f.index(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))];
          negative += value[c] < 0 ? 1 : 0;
        }
        if (negative == 0 || negative == 8) continue;
        const auto vertex = [&](int a, int b) {
          const int from = std::min(a, b), to = std::max(a, b);  // `to` has all bits of `from`
          const std::size_t node = f.index(x + (from & 1), y + (from >> 1 & 1), z + (from >> 2));
          const auto [found, is_new] = vertices.try_emplace(
              static_cast<std::uint64_t>(node) * 8 + static_cast<std::uint64_t>(to ^ from),
              static_cast<int>(mesh.position.size()));
          if (is_new) {
            // Away from the nodes, so that no triangle shrinks to a point.
            const float t = std::clamp(value[from] / (value[from] - value[to]), 0.02f, 0.98f);
            const auto at = [&](int c) {
              return Vec3(static_cast<float>(x + (c & 1)), static_cast<float>(y + (c >> 1 & 1)),
                          static_cast<float>(z + (c >> 2)));
            };
            mesh.position.push_back(f.origin + f.step_m * (at(from) + t * (at(to) - at(from))));
          }
          return found->second;
        };
        for (const auto& corner : kTetrahedra) {
          int inside[4], outside[4], in = 0, out = 0;
          for (int i = 0; i < 4; ++i) {
            value[corner[i]] < 0 ? inside[in++] = i : outside[out++] = i;
          }
          if (in == 0 || in == 4) continue;
          // Even permutations that begin with the one, or the two, that differ from the others.
          constexpr int kOne[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 0, 1, 3}, {3, 0, 2, 1}};
          constexpr int kTwo[6][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2},
                                      {1, 2, 0, 3}, {1, 3, 2, 0}, {2, 3, 0, 1}};
          const auto cut = [&](int i, int j) { return vertex(corner[i], corner[j]); };
          if (in == 2) {
            const int* p = *std::find_if(std::begin(kTwo), std::end(kTwo), [&](const int(&row)[4]) {
              return row[0] == inside[0] && row[1] == inside[1];
            });
            const int a = cut(p[0], p[2]), b = cut(p[0], p[3]), c = cut(p[1], p[3]),
                      d = cut(p[1], p[2]);
            mesh.faces.push_back({a, b, c});
            mesh.faces.push_back({a, c, d});
          } else {
            const int* p = kOne[in == 1 ? inside[0] : outside[0]];
            const int a = cut(p[0], p[1]), b = cut(p[0], p[2]), c = cut(p[0], p[3]);
            mesh.faces.push_back(in == 1 ? std::array{a, b, c} : std::array{a, c, b});
          }
        }
      }
    }
  }
  return mesh;
}

SolidMesh thicken(const Surface& cloth, float half, float step) {
  if (cloth.position.empty()) throw Error("solid mesh: there is no cloth to thicken");
  Vec3 low = cloth.position[0], high = low;
  for (const auto& p : cloth.position) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  Field f = empty_field(low, high, half, step);
  for (const auto& face : cloth.faces) {
    const Vec3 &a = cloth.position[static_cast<std::size_t>(face[0])],
               &b = cloth.position[static_cast<std::size_t>(face[1])],
               &c = cloth.position[static_cast<std::size_t>(face[2])];
    const float reach = half + 2 * step;
    const Vec3 from = (a.cwiseMin(b).cwiseMin(c) - f.origin).array() - reach;
    const Vec3 to = (a.cwiseMax(b).cwiseMax(c) - f.origin).array() + reach;
    int first[3], last[3];
    for (int i = 0; i < 3; ++i) {
      const int n = f.nodes[static_cast<std::size_t>(i)];
      first[i] = std::max(0, static_cast<int>(from[i] / step));
      last[i] = std::min(n - 1, static_cast<int>(to[i] / step) + 1);
    }
    for (int z = first[2]; z <= last[2]; ++z) {
      for (int y = first[1]; y <= last[1]; ++y) {
        for (int x = first[0]; x <= last[0]; ++x) {
          const Vec3 p = f.origin + step * Vec3(static_cast<float>(x), static_cast<float>(y),
                                                static_cast<float>(z));
          float& value = f.value[f.index(x, y, z)];
          value = std::min(value, distance_to_triangle(p, a, b, c) - half);
        }
      }
    }
  }
  return zero_surface(std::move(f));
}

SolidMesh unite(const std::vector<Prism>& prisms, float step) {
  if (prisms.empty()) throw Error("solid mesh: there is no prism to unite");
  Vec3 low = Vec3::Constant(1e9f), high = -low;
  for (const auto& prism : prisms) {
    for (const auto& p : prism.outline) {
      low = low.cwiseMin(Vec3(p.x(), p.y(), prism.low_m));
      high = high.cwiseMax(Vec3(p.x(), p.y(), prism.high_m));
    }
  }
  Field f = empty_field(low, high, 0.0f, step);
  for (int z = 0; z < f.nodes[2]; ++z) {
    for (int y = 0; y < f.nodes[1]; ++y) {
      for (int x = 0; x < f.nodes[0]; ++x) {
        const Vec3 p = f.origin + step * Vec3(static_cast<float>(x), static_cast<float>(y),
                                              static_cast<float>(z));
        float& value = f.value[f.index(x, y, z)];
        for (const auto& prism : prisms) value = std::min(value, signed_distance(prism, p));
      }
    }
  }
  return zero_surface(std::move(f));
}

void write_obj(const std::string& path, const SolidMesh& mesh, const std::string& comment) {
  fmt::memory_buffer text;
  fmt::format_to(std::back_inserter(text), "# {}\n# metres, z up, closed, normals outwards\n",
                 comment);
  for (const auto& p : mesh.position) {
    fmt::format_to(std::back_inserter(text), "v {:.5f} {:.5f} {:.5f}\n", p.x(), p.y(), p.z());
  }
  for (const auto& f : mesh.faces) {
    fmt::format_to(std::back_inserter(text), "f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1);
  }
  write_text_file(path, fmt::to_string(text));
}

}  // namespace weft::synth
