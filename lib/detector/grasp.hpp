#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "base/options.hpp"
#include "detector/types.hpp"
#include "rgbd/frame.hpp"

namespace weft::detector {

/// Where to take hold of detected parts. A candidate is a garment pixel of the detection's box,
/// away from the outline and from holes in the depth, and not at the table's height. Preferred are
/// folds and borders that stand out against the cloth around them, near the middle of the box.
struct GraspOptions {
  double patch_m = 0.015;
  double outline_margin_m = 0.006;
  double min_height_m = 0.002;
  double min_coverage = 0.9;
  double prominence_m = 0.010;
  double prominence_weight = 0.5;
  double centre_share = 0.35;
  double max_residual_m = 0.006;
  std::vector<double> T_base_camera;

  void visit(OptionVisitor& v) {
    v.field("patch_m", patch_m, {0.003, 0.1}, "m",
            "radius of the patch of cloth whose plane gives the normal: half a gripper's finger");
    v.field("outline_margin_m", outline_margin_m, {0.0, 0.1}, "m",
            "distance from the garment's outline: colour and depth are registered to a few px");
    v.field("min_height_m", min_height_m, {-0.1, 0.5}, "m",
            "height above the table, its distortion removed, at least; 0.7 of the height of the "
            "cloth in the box is needed too");
    v.field("min_coverage", min_coverage, {0.1, 1.0}, "", "share of the patch with depth at least");
    v.field("prominence_m", prominence_m, {0.001, 0.5}, "m",
            "height over the surroundings that counts as a perfect fold to grasp");
    v.field("prominence_weight", prominence_weight, {0.0, 1.0}, "",
            "share of the score that prominence decides");
    v.field("centre_share", centre_share, {0.01, 10.0}, "",
            "distance from the box's centre, in box sizes, at which a point is worth half");
    v.field("max_residual_m", max_residual_m, {0.001, 0.1}, "m",
            "root mean square distance of the patch from its plane at most");
    v.field("T_base_camera", T_base_camera, {0, 16}, "",
            "pose of the camera in the robot's base: none, 7 numbers (x y z in m, quaternion x y z "
            "w) or the 16 of a 4x4 matrix row by row");
  }
  /// T_base_camera must have 0, 7 or 16 numbers and be a rotation and a translation.
  void validate() const;
};

/// The pose of the camera in the robot's base; nothing when none is configured.
std::optional<Eigen::Isometry3d> base_from_camera(const GraspOptions& options);

/// One grasp a detection at most, best first; score = the detection's probability times the quality
/// of the place, 0 to 1. mask: CV_8UC1 of the frame's size, 255 = garment. table: its height test
/// is left out without one. Class A: the same bits everywhere. Throws Error when mask or depth do
/// not fit the camera.
std::vector<Grasp> find_grasps(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                               const std::optional<rgbd::Plane>& table,
                               const std::vector<Detection>& detections,
                               const GraspOptions& options);

}  // namespace weft::detector
