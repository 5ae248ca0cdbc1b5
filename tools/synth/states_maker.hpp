#pragma once

#include <functional>
#include <string>
#include <vector>

#include "synth/dataset_maker.hpp"
#include "synth/room_scene.hpp"
#include "synth/states_recipe.hpp"

/// The sets of T-shirts in six states: images for instance segmentation, meshes, sequences.
namespace weft::synth {

struct StatesProgress {
  const char* stage = "";  // what is counted: simulations, meshes, images, frames
  int done = 0, total = 0;
  double seconds_left = -1.0;  // of the stage; negative: not known yet
  int given_up = 0;            // simulations
  bool stopped = false;
};

using StatesReport = std::function<void(const StatesProgress&)>;

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

/// A folder for each sequence, in the format of the TUM RGB-D benchmark (Sturm et al. 2012): rgb/,
/// depth/ (16 bits, 5000 a metre), rgb.txt, depth.txt, associations.txt, groundtruth.txt (pose of
/// the colour camera, z forward, in the desk's frame, z up); beside them masks/ (instances),
/// instances.json (COCO) and camera.yaml.
StatesProgress make_sequences(SimulationSource& simulations, const std::string& out,
                              const SequencesRecipe& recipe, const std::string& settings, int jobs,
                              const StatesReport& report, const std::function<bool()>& stopped);

/// A robot's way round the desk: position and gaze are smooth functions of time.
struct CameraPath {
  double radius_m = 1.3, height_m = 0.6, speed_mps = 0.25, start = 0.0, direction = 1.0;
  double sway_m = 0.1, shake_m = 0.002, phase[6] = {};
  CameraPose at(double seconds) const;
};
CameraPath draw_path(Random& random);

/// "tx ty tz qx qy qz qw" of T_world_camera.
std::string tum_pose(const CameraPose& pose);

/// Seconds with six decimals, of a frame at 30 Hz.
std::string tum_stamp(int frame);

/// Depth in millimetres to the 5000 units a metre of the TUM format.
cv::Mat tum_depth(const cv::Mat& depth_mm);

}  // namespace weft::synth
