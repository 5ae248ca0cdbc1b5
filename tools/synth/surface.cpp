#include "synth/surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace weft::synth {
namespace {

/// Edges of all faces, those of one pair of vertices next to each other.
struct HalfEdge {
  int low, high;     // its ends
  int opposite;      // third corner of the face
  int face, corner;  // the edge runs from corner to corner + 1
};

std::size_t at(int i) { return static_cast<std::size_t>(i); }

std::vector<HalfEdge> half_edges(const Surface& in) {
  std::vector<HalfEdge> halves;
  halves.reserve(in.faces.size() * 3);
  for (std::size_t f = 0; f < in.faces.size(); ++f) {
    for (int c = 0; c < 3; ++c) {
      const int a = in.faces[f][at(c)], b = in.faces[f][at((c + 1) % 3)];
      halves.push_back(
          {std::min(a, b), std::max(a, b), in.faces[f][at((c + 2) % 3)], static_cast<int>(f), c});
    }
  }
  std::sort(halves.begin(), halves.end(), [](const HalfEdge& a, const HalfEdge& b) {
    return std::tie(a.low, a.high, a.face) < std::tie(b.low, b.high, b.face);
  });
  return halves;
}

}  // namespace

Surface subdivide(const Surface& in, std::vector<std::array<int, 2>>& parents) {
  const std::vector<HalfEdge> halves = half_edges(in);
  Surface out;
  const std::size_t old_count = in.position.size();
  out.position.resize(old_count);
  out.pattern = in.pattern;
  std::vector<Vec3> ring(old_count, Vec3::Zero()), crease(old_count, Vec3::Zero());
  std::vector<int> ring_count(old_count, 0), crease_count(old_count, 0);
  std::vector<std::array<int, 3>> middle(in.faces.size());
  parents.clear();
  for (std::size_t i = 0; i < halves.size();) {
    std::size_t end = i;
    while (end < halves.size() && halves[end].low == halves[i].low &&
           halves[end].high == halves[i].high) {
      ++end;
    }
    const int a = halves[i].low, b = halves[i].high;
    const Vec3 &pa = in.position[at(a)], &pb = in.position[at(b)];
    const bool smooth = end - i == 2;
    const int vertex = static_cast<int>(out.position.size());
    if (smooth) {
      out.position.push_back(
          0.375f * (pa + pb) +
          0.125f * (in.position[at(halves[i].opposite)] + in.position[at(halves[i + 1].opposite)]));
    } else {
      out.position.push_back(0.5f * (pa + pb));
      crease[at(a)] += pb;
      crease[at(b)] += pa;
      ++crease_count[at(a)];
      ++crease_count[at(b)];
    }
    ring[at(a)] += pb;
    ring[at(b)] += pa;
    ++ring_count[at(a)];
    ++ring_count[at(b)];
    out.pattern.push_back(0.5f * (in.pattern[at(a)] + in.pattern[at(b)]));
    parents.push_back({a, b});
    for (; i < end; ++i) middle[at(halves[i].face)][at(halves[i].corner)] = vertex;
  }
  for (std::size_t v = 0; v < old_count; ++v) {
    const int n = ring_count[v];
    if (crease_count[v] == 2) {
      out.position[v] = 0.75f * in.position[v] + 0.125f * crease[v];
    } else if (crease_count[v] > 0 || n == 0) {
      out.position[v] = in.position[v];
    } else {
      const double c = 0.375 + 0.25 * cosine(2 * kPi / n);
      const float beta = static_cast<float>((0.625 - c * c) / n);
      out.position[v] = (1.0f - static_cast<float>(n) * beta) * in.position[v] + beta * ring[v];
    }
  }
  out.faces.reserve(in.faces.size() * 4);
  for (std::size_t f = 0; f < in.faces.size(); ++f) {
    const auto& v = in.faces[f];
    const auto& m = middle[f];
    out.faces.push_back({v[0], m[0], m[2]});
    out.faces.push_back({m[0], v[1], m[1]});
    out.faces.push_back({m[2], m[1], v[2]});
    out.faces.push_back({m[0], m[1], m[2]});
    out.panel_of_face.insert(out.panel_of_face.end(), 4, in.panel_of_face[f]);
  }
  compute_normals(out);
  return out;
}

void smooth(Surface& s, int times, int crease_times) {
  const std::vector<HalfEdge> halves = half_edges(s);
  std::vector<char> on_crease(s.position.size(), 0);
  struct Edge {
    int a, b;
    bool crease;
  };
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < halves.size();) {
    std::size_t end = i;
    while (end < halves.size() && halves[end].low == halves[i].low &&
           halves[end].high == halves[i].high) {
      ++end;
    }
    const auto panel = [&](std::size_t h) { return s.panel_of_face[at(halves[h].face)]; };
    const bool crease = end - i != 2 || panel(i) != panel(i + 1);
    edges.push_back({halves[i].low, halves[i].high, crease});
    if (crease) on_crease[at(halves[i].low)] = on_crease[at(halves[i].high)] = 1;
    i = end;
  }
  std::vector<Vec3> sum(s.position.size());
  std::vector<int> count(s.position.size());
  const auto step = [&](float share, bool creases_only) {
    std::fill(sum.begin(), sum.end(), Vec3(Vec3::Zero()));
    std::fill(count.begin(), count.end(), 0);
    for (const auto& [a, b, crease] : edges) {
      if (creases_only && !crease) continue;
      for (const auto& [to, from] : {std::pair(a, b), std::pair(b, a)}) {
        if (on_crease[at(to)] != 0 && !crease) continue;
        sum[at(to)] += s.position[at(from)];
        ++count[at(to)];
      }
    }
    for (std::size_t v = 0; v < s.position.size(); ++v) {
      // Corners, where creases meet or end, stay.
      if (count[v] == 0 || (on_crease[v] != 0 && count[v] != 2)) continue;
      s.position[v] += share * (sum[v] / static_cast<float>(count[v]) - s.position[v]);
    }
  };
  for (int i = 0; i < crease_times; ++i) {
    step(0.5f, true);
    step(-0.53f, true);
  }
  for (int i = 0; i < times; ++i) {
    step(0.5f, false);
    step(-0.53f, false);
  }
  compute_normals(s);
}

void compute_normals(Surface& s) {
  s.normal.assign(s.position.size(), Vec3::Zero());
  for (const auto& f : s.faces) {
    const Vec3 &a = s.position[at(f[0])], &b = s.position[at(f[1])], &c = s.position[at(f[2])];
    const Vec3 n = (b - a).cross(c - a);
    for (const int v : f) s.normal[at(v)] += n;
  }
  for (auto& n : s.normal) {
    const float length = n.norm();
    n = length > 1e-20f ? Vec3(n / length) : Vec3(0, 0, 1);
  }
}

double mean_edge_length(const Surface& s) {
  double sum = 0.0;
  for (const auto& f : s.faces) {
    for (int c = 0; c < 3; ++c) {
      sum += (s.position[at(f[at(c)])] - s.position[at(f[at((c + 1) % 3)])]).norm();
    }
  }
  return s.faces.empty() ? 0.0 : sum / (3.0 * static_cast<double>(s.faces.size()));
}

}  // namespace weft::synth
