#pragma once

#include <optional>

#include "synth/room_scene.hpp"

namespace weft::synth {

/// How T-shirts lie to each other: the sets v3ma, v3mcd and v3mcs of the garment SLAM paper.
enum class Neighbours { kApart, kTouching };

/// Turned at random, whole on the desk, none over another: apart by 25 mm or more, or (from the
/// second on) moved up to the others until they touch. nullopt: no place found.
std::optional<std::vector<Placement>> arrange(Random& random,
                                              const std::vector<const Simulation*>& garments,
                                              const Prism& desk_top, Neighbours neighbours);

/// Colours that nobody takes for one another, or one fabric for all.
std::vector<Fabric> draw_fabrics(Random& random, const std::vector<const Simulation*>& garments,
                                 const Vec3& desk_colour, bool same, bool different);

}  // namespace weft::synth
