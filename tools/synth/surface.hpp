#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "synth/maths.hpp"

/// Triangle meshes of cloth, refined so that the simulator's triangles do not show.
namespace weft::synth {

struct Surface {
  std::vector<Vec3> position;  // metres
  std::vector<Vec3> normal;    // unit length, towards the outside
  std::vector<Vec2> pattern;   // metres, in the pattern of the vertex's panel
  std::vector<std::array<int, 3>> faces;
  std::vector<std::uint8_t> panel_of_face;
};

/// One step of Loop subdivision (Loop 1987) of the positions with linear pattern coordinates. Edges
/// of one face, or of more than two, are creases. parents: for each new vertex, which follow the
/// old ones, the two ends of its edge.
Surface subdivide(const Surface& surface, std::vector<std::array<int, 2>>& parents);

/// Values of old vertices, continued at the new ones by the mean of their edge's ends.
template <class T>
void interpolate_new(std::vector<T>& values, const std::vector<std::array<int, 2>>& parents) {
  values.reserve(values.size() + parents.size());
  for (const auto& [a, b] : parents) {
    T v = values[static_cast<std::size_t>(a)];
    v += values[static_cast<std::size_t>(b)];
    v *= 0.5f;
    values.push_back(v);
  }
}

/// Smoothing without shrinking (Taubin 1995), `times` times: takes away ripples of the length of
/// two edges, which cloth simulation leaves. Creases, which are borders and seams between panels,
/// are smoothed as lines, crease_times more often: there the ripples are strongest, and they show
/// as a scalloped outline.
void smooth(Surface& surface, int times, int crease_times);

/// Area-weighted vertex normals.
void compute_normals(Surface& surface);

double mean_edge_length(const Surface& surface);

}  // namespace weft::synth
