#pragma once

#include "base/options.hpp"

namespace weft::synth {

/// T-shirts in six states on desks. With the version of the program it decides every byte.
struct StatesRecipe {
  int seed = 1;
  int simulations = 44;
  int attempts = 10;
  int scenes = 400;
  int views = 4;
  int samples = 2;
  double mesh_step_mm = 4.0;

  void visit(OptionVisitor& v) {
    v.field("seed", seed, {0, 1 << 30}, "", "of everything that is drawn");
    v.field("simulations", simulations, {1, 10000}, "",
            "T-shirts; 44 are 4 flat, 12 strip, 9 stack, 4 fold-2, 10 fold-4 and 5 fold-s");
    v.field("attempts", attempts, {1, 10}, "", "poses tried before a T-shirt is given up");
    v.field("scenes", scenes, {1, 100000}, "", "images");
    v.field("views", views, {1, 4}, "", "images of each arrangement of T-shirts on a desk");
    v.field("samples", samples, {1, 4}, "", "colour samples a pixel along each axis");
    v.field("mesh_step_mm", mesh_step_mm, {2.0, 10.0}, "mm",
            "grid of the closed meshes; they are 0.9 of it thicker on each side than cloth");
  }
  void validate() const { validate_fields(*this, "StatesRecipe"); }
};

struct SequencesRecipe {
  enum class View { kRound, kAbove };
  View view = View::kRound;
  int seed = 1;
  int simulations = 44;
  int attempts = 10;
  int scenes = 4;
  double seconds = 20.0;
  int samples = 2;

  void visit(OptionVisitor& v) {
    v.choice("view", view, {{"round", View::kRound}, {"above", View::kAbove}},
             "round: a robot drives round a desk with T-shirts; above: an arm carries the camera "
             "over one garment, near enough to find its parts");
    v.field("seed", seed, {0, 1 << 30}, "", "of everything that is drawn");
    v.field("simulations", simulations, {1, 10000}, "", "T-shirts to choose from");
    v.field("attempts", attempts, {1, 10}, "", "poses tried before a T-shirt is given up");
    v.field("scenes", scenes, {1, 1000}, "", "sequences");
    v.field("seconds", seconds, {0.1, 600.0}, "s", "length of a sequence, at 30 Hz");
    v.field("samples", samples, {1, 4}, "",
            "colour samples a pixel along each axis; with one, fine textures flicker");
  }
  void validate() const { validate_fields(*this, "SequencesRecipe"); }
};

}  // namespace weft::synth
