#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/options.hpp"

namespace weft::synth {

struct SynthOptions {
  int seed = 1;
  int views = 2;
  int samples = 2;
  double double_share = 0.08;
  double test_share = 0.15;

  void visit(OptionVisitor& v) {
    v.field("seed", seed, {0, 1 << 30}, "", "draws cameras, light, fabrics, noise and the split");
    v.field("views", views, {1, 4}, "",
            "views of each simulation; more than four teach little that is new");
    v.field("samples", samples, {1, 4}, "", "colour samples a pixel along each axis");
    v.field("double_share", double_share, {0.0, 1.0}, "",
            "share of the views that show a second garment");
    v.field("test_share", test_share, {0.0, 0.9}, "",
            "share of the simulations with seen cuts that are kept for test-seen");
  }
  void validate() const { validate_fields(*this, "SynthOptions"); }
};

struct SynthProgress {
  int done = 0, skipped = 0, failed = 0, total = 0;  // scenes
  double seconds = 0.0;                              // since the start
  std::string last;                                  // name of the scene, or the error
};

/// Renders every simulation (*.wsim) of a folder into a data set of the IRI layout with
/// manifest.jsonl (one JSON object a scene) and dataset.json (version and options). Finished scenes
/// are kept unless their simulation changed: a run may be cut off and taken up again, or go on when
/// simulations were added, best under names that sort last (second garments are drawn from earlier
/// ones). Same simulations, options and version give the same bytes. Splits are by simulation:
/// test-held-out where the cut is reserved (fabrics reserved too), otherwise test-seen for
/// test_share of them, train for the rest. Throws Error when the output folder was made with other
/// options or nothing can be read.
SynthProgress make_dataset(const std::string& simulations, const std::string& out,
                           const SynthOptions& options, int jobs,
                           const std::function<void(const SynthProgress&)>& report);

/// PNG of up to `count` scenes of a data set side by side, with their polygons (grey = ignored).
void write_contact_sheet(const std::string& dataset, const std::string& png, int count);

}  // namespace weft::synth
