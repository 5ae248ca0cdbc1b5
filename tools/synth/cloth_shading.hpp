#pragma once

#include "synth/view_scene.hpp"

namespace weft::synth {

/// A point of a surface that a ray has hit: values of the face's corners, blended.
struct Triangle {
  int vertex[3];
  float weight[3];
  explicit Triangle(const Surface& s, const RayHit& hit) {
    for (int i = 0; i < 3; ++i)
      vertex[i] = s.faces[static_cast<std::size_t>(hit.face)][static_cast<std::size_t>(i)];
    weight[0] = 1.0f - hit.u - hit.v;
    weight[1] = hit.u;
    weight[2] = hit.v;
  }
  template <class T>
  T blend(const std::vector<T>& values) const {
    return values[static_cast<std::size_t>(vertex[0])] * weight[0] +
           values[static_cast<std::size_t>(vertex[1])] * weight[1] +
           values[static_cast<std::size_t>(vertex[2])] * weight[2];
  }
};

/// Linear RGB that cloth sends back against `direction`. placed: the garment's fine surface in the
/// world; light: by its vertices.
Vec3 cloth_radiance(const Garment& garment, const Surface& placed, const Fabric& fabric,
                    const std::vector<Irradiance>& light_of_vertex, const RayHit& hit,
                    const Vec3& direction);

}  // namespace weft::synth
