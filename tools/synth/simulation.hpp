#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "synth/maths.hpp"

/// A simulated garment as the cloth simulator leaves it: a .wsim file (docs/simulation-format.md).
namespace weft::synth {

struct Panel {
  std::string name;
  std::string side;  // "front" or "back"
  int layer = 0;
};

/// A piece of a part: the inside of a polygon of a panel, or what lies within width_m of a line.
struct PartRegion {
  int panel = 0;
  std::vector<Vec2> points;
  bool is_line = false;
  float width_m = 0.0f;
};

struct PartInstance {
  std::string part;      // "polo collar"
  std::string instance;  // "collar", "left", "right"
  std::vector<PartRegion> regions;
};

/// Something the renderer draws, in pattern coordinates.
struct Feature {
  std::string kind;
  int panel = 0;
  std::vector<Vec2> points;  // polygon, polyline or the named edge
  float width_m = 0.0f;      // of hem, rib, cord
  float offset_m = 0.0f;     // between the two rows of a twin stitch
  float radius_m = 0.0f;     // of button, rivet; their centre is points[0]
  float height_m = 0.0f;     // how far it stands off the cloth; 0: the kind's own
  bool inside = false;       // drawn on the inside face only
  bool outside = false;      // drawn on the outside face only
};

struct Simulation {
  std::string name;  // file name without extension
  std::int64_t seed = 0, index = 0;
  std::string generator, garment, state, cut;  // cut: JSON object
  bool held_out = false;                       // the cut is reserved for testing
  bool turned_over = false;
  double wrinkledness_deg = 0.0;
  std::vector<Panel> panels;
  std::vector<PartInstance> parts;
  std::vector<Feature> features;
  std::vector<Vec2> pattern;                // by vertex
  std::vector<Vec3> pose;                   // by vertex; world, metres, table top at z = 0
  std::vector<std::array<int, 3>> faces;    // counter-clockwise seen from outside
  std::vector<std::uint8_t> panel_of_face;  // index into panels
};

/// Throws Error naming the file, the key or array, and what is wrong with it.
Simulation read_simulation(const std::string& path);

/// Writes the same format. Edges become polylines of the regions and features that name them.
void write_simulation(const std::string& path, const Simulation& simulation);

}  // namespace weft::synth
