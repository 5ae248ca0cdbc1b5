#pragma once

#include <functional>
#include <string>
#include <vector>

#include "synth/prism.hpp"

/// Closed meshes of thin things, ready for signed-distance sampling.
namespace weft::synth {

/// Closed, oriented outwards, every edge of exactly two faces.
struct SolidMesh {
  std::vector<Vec3> position;
  std::vector<std::array<int, 3>> faces;
};

/// A function sampled at the nodes of a grid, x fastest; negative inside.
struct Field {
  Vec3 origin = Vec3::Zero();
  float step_m = 0.0f;
  std::array<int, 3> nodes{};  // along x, y, z
  std::vector<float> value;

  std::size_t index(int x, int y, int z) const;
};

/// The surface where the field is zero (marching tetrahedra, six to a cell: Doi and Koide 1991).
/// Hollows that are not joined to the outside are filled. The field must be positive at the border.
SolidMesh zero_surface(Field field);

/// All points within half_m of the cloth, hollows filled: layers that lie on each other become one
/// solid. half_m: at least 0.87 step_m, or thin cloth would get holes.
SolidMesh thicken(const Surface& cloth, float half_m, float step_m);

/// The union of the prisms.
SolidMesh unite(const std::vector<Prism>& prisms, float step_m);

/// Metres, z up. The file appears whole or not at all.
void write_obj(const std::string& path, const SolidMesh& mesh, const std::string& comment);

}  // namespace weft::synth
