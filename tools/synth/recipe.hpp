#pragma once

#include <string>
#include <vector>

#include "base/options.hpp"

namespace weft::synth {

/// What garments.py draws: which garments come to lie on the table, and how.
struct SimulationOptions {
  std::vector<std::string> garments = {"tshirt",  "polo",    "jeans",  "shirt", "sweater",
                                       "dress",   "tshirt",  "polo",   "jeans", "shirt",
                                       "sweater", "dress",   "tshirt", "polo",  "jeans",
                                       "shirt",   "sweater", "dress",  "towel", "blanket"};
  std::vector<double> state_shares = {0.30, 0.25, 0.25, 0.20};
  double held_out_share = 0.25;
  double turned_over_share = 0.3;
  int vertices = 4600;
  int attempts = 3;

  void visit(OptionVisitor& v) {
    v.field("garments", garments, "types of a round, each round in an order of its own");
    v.field("state_shares", state_shares, {4, 4}, "", "of flat, wrinkled, folded, crumpled");
    v.field("held_out_share", held_out_share, {0.0, 1.0}, "",
            "share of the garments of a cut that is reserved for testing");
    v.field("turned_over_share", turned_over_share, {0.0, 1.0}, "",
            "share of the garments that lie face down");
    v.field("vertices", vertices, {500, 20000}, "",
            "of a garment's mesh, as far as edges of 11.5 to 14.5 mm allow");
    v.field("attempts", attempts, {1, 10}, "", "poses tried before a garment is given up");
  }
  void validate() const;
};

/// What is drawn for the views of a simulated garment.
struct RenderOptions {
  int views = 3;
  int samples = 2;
  double double_share = 0.08;
  double test_share = 0.15;

  void visit(OptionVisitor& v) {
    v.field("views", views, {1, 4}, "",
            "views of each simulation; more than four teach little that is new");
    v.field("samples", samples, {1, 4}, "", "colour samples a pixel along each axis");
    v.field("double_share", double_share, {0.0, 1.0}, "",
            "share of the views that show a second garment");
    v.field("test_share", test_share, {0.0, 0.9}, "",
            "share of the simulations with seen cuts that are kept for test-seen");
  }
  void validate() const { validate_fields(*this, "RenderOptions"); }
};

/// A garment parts set: with the version of the program it decides every byte.
struct PartsRecipe {
  int seed = 1;
  int scenes = 1200;
  SimulationOptions simulation;
  RenderOptions render;

  void visit(OptionVisitor& v) {
    v.field("seed", seed, {0, 1 << 30}, "", "of everything that is drawn");
    v.field("scenes", scenes, {1, 100000}, "",
            "views in all; a set can grow by asking for more of them");
    v.group("simulation", simulation);
    v.group("render", render);
  }
  void validate() const {
    validate_fields(*this, "PartsRecipe");
    simulation.validate();
  }
};

}  // namespace weft::synth
