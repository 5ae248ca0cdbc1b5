#pragma once

#include "synth/desk_scenes.hpp"
#include "synth/states_recipe.hpp"

/// Sequences of a camera that moves round a desk, or is carried over it.
namespace weft::synth {

/// A folder for each sequence, in the format of the TUM RGB-D benchmark (Sturm et al. 2012): rgb/,
/// depth/ (16 bits, 5000 a metre), rgb.txt, depth.txt, associations.txt, groundtruth.txt (pose of
/// the colour camera, z forward, in the desk's frame, z up); beside them masks/ (instances),
/// camera.yaml and, by the recipe's view, instances.json (COCO) or garments.json (where in the
/// desk's frame the garment and its parts are). Above, one simulation that lies flat or wrinkled,
/// face up, is drawn for each sequence; round a desk all must be T-shirts in one of the six states.
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

/// An arm's sweep over what lies at `target`, up to about 20 degrees from straight above.
struct ArmPath {
  Eigen::Vector3d target = Eigen::Vector3d::Zero();
  double height_m = 0.9, reach_m[2] = {0.2, 0.15}, period_s[2] = {7.0, 5.0};
  double lift_m = 0.05, turn = 0.3, yaw = 0.0, shake_m = 0.001, phase[6] = {};
  CameraPose at(double seconds) const;
};
ArmPath draw_arm_path(Random& random, const Eigen::Vector3d& target);

/// Seconds with six decimals, of a frame at 30 Hz.
std::string tum_stamp(int frame);

}  // namespace weft::synth
