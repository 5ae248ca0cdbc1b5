#pragma once

#include "synth/desk_scenes.hpp"
#include "synth/states_recipe.hpp"

/// The set of T-shirts in six states: images for instance segmentation, and meshes.
namespace weft::synth {

/// Files, in `out`: images/, depth/ (16 bits, 5000 a metre), labels/ (instances), meta/,
/// annotations/instances_*.json (COCO: train, test, and the paper's versions and test subsets),
/// meshes/STATE/*.obj, meshes/desk/*.obj, contact-sheet.png, summary.txt, dataset.json. Splits are
/// by simulation: every fourth of a state is for testing; scenes whose T-shirts touch in the same
/// fabric are for testing only. What is finished is kept; same simulations, recipe and version give
/// the same bytes. settings: what dataset.json says about how the set was made. Throws Error when
/// the folder was made with others.
StatesProgress make_states(SimulationSource& simulations, const std::string& out,
                           const StatesRecipe& recipe, const std::string& settings, int jobs,
                           const StatesReport& report, const std::function<bool()>& stopped);

/// What the images of an arrangement are for, and how its T-shirts lie: "single", "apart",
/// "touching-different-colours" or "touching-same-colour".
struct ArrangementPlan {
  bool test = false;
  std::string kind;
};

/// Every fourth arrangement is for testing (none where no simulation is). The kinds follow each
/// other so that even a few arrangements of a split have each kind in about its share: of those for
/// testing 35, 30, 20 and 15 %, of those for training 35, 30, 35 and none.
ArrangementPlan plan_arrangement(int index, bool any_test);

}  // namespace weft::synth
