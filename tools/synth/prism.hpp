#pragma once

#include <vector>

#include "synth/surface.hpp"

namespace weft::synth {

/// An upright solid: a convex outline, counter-clockwise seen from above, from low_m to high_m.
/// Desks, walls and furniture are made of them.
struct Prism {
  std::vector<Vec2> outline;
  float low_m = 0.0f, high_m = 0.0f;
};

/// size, centre: in the plane; sine, cosine: of the turn about its centre.
Prism make_box(const Vec2& centre, const Vec2& size, float low_m, float high_m, float sine = 0.0f,
               float cosine = 1.0f);
/// A regular polygon of 48 corners.
Prism make_cylinder(const Vec2& centre, float radius_m, float low_m, float high_m);

/// Metres, negative inside.
float signed_distance(const Prism& prism, const Vec3& point);
bool contains(const Prism& prism, const Vec2& point);

/// Its faces as a grid of edges up to step_m, which shares no vertex between faces. `pattern` are
/// metres on the face, along its lower edge and upwards (top and bottom: along the first side and
/// across); panel_of_face is the side's number, then top, then bottom.
Surface tessellate(const Prism& prism, float step_m);

}  // namespace weft::synth
