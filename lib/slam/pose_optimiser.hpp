#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/observations.hpp"

namespace weft::slam {

struct PoseOptions {
  int rounds = 4;
  int iterations = 10;
  double unobserved_sigma = 1.0;
  PlaneNoise plane_noise;

  void visit(OptionVisitor& v) {
    v.field("rounds", rounds, {1, 20}, "",
            "optimise, then sort the observations into inliers and outliers anew by the 95 % "
            "chi-squared test; the last round works without Huber's kernel; ORB-SLAM2: 4");
    v.field("iterations", iterations, {1, 100}, "",
            "of Levenberg-Marquardt in a round, at most; ORB-SLAM2: 10");
    v.field("unobserved_sigma", unobserved_sigma, {1e-3, 1e3}, "m, rad",
            "directions the observations tell less well than this keep the start");
    v.group("plane_noise", plane_noise);
  }
  void validate() const { validate_fields(*this, "PoseOptions"); }
};

/// What is believed about the pose before the observations are looked at.
struct PosePrior {
  Rigid3d T_camera_world;
  Matrix6d information = Matrix6d::Zero();  // of minus(T, T_camera_world)
};

struct PoseResult {
  Rigid3d T_camera_world;
  std::vector<std::uint8_t> point_inlier;  // 1 or 0 for each observation
  std::vector<std::uint8_t> plane_inlier;
  int point_inliers = 0;
  int plane_inliers = 0;
  /// Sum of the inliers' information about the pose's increment (see tangent.hpp), the prior's
  /// included. Its inverse is the pose's covariance where observed_directions = 6.
  Matrix6d information = Matrix6d::Zero();
  /// How many of the six directions of motion the observations determine; along the others the
  /// pose keeps its start (fewer than three independent plane normals, fewer than three points).
  int observed_directions = 0;
  double chi_squared = 0.0;    // of the inliers
  int degrees_of_freedom = 0;  // their dimensions less observed_directions, at least 0
  int iterations = 0;
};

/// One camera against fixed landmarks. points_world: what PointObservation::point counts; planes:
/// what PlaneObservation::plane counts; the observations' camera indices are not looked at. start:
/// the motion model's prediction. Levenberg-Marquardt on the six increments with Huber's kernel.
/// Points less than 5 cm before the camera are outliers. Throws Error on values that are not
/// finite, indices out of range and variances that are not positive.
PoseResult optimise_pose(const CameraModel& camera, const Rigid3d& start,
                         std::span<const Eigen::Vector3d> points_world,
                         std::span<const PlaneState> planes,
                         std::span<const PointObservation> point_observations,
                         std::span<const PlaneObservation> plane_observations,
                         const PoseOptions& options = {},
                         const std::optional<PosePrior>& prior = std::nullopt);

}  // namespace weft::slam
