#pragma once

#include <cstdint>
#include <vector>

#include "slam/observations.hpp"

namespace weft::slam {

struct CameraState {
  Rigid3d T_camera_world;
  bool fixed = false;
};
struct PointState {
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();
  bool fixed = false;
};
struct ObjectState {
  Rigid3d T_world_object;
  bool fixed = false;
};

/// A measured pose of camera_b as seen from camera_a: odometry, or a loop.
struct RelativePose {
  int camera_a = 0;
  int camera_b = 0;
  Rigid3d T_a_b;
  Matrix6d information = Matrix6d::Identity();  // of (rotation [rad], translation [m])
};

/// Everything that is optimised together, and what was measured. Observations refer to the lists by
/// index. At least one camera is fixed (else nothing says where the world is).
struct BundleProblem {
  std::vector<CameraState> cameras;
  std::vector<PointState> points;
  std::vector<PlaneState> planes;
  std::vector<ObjectState> objects;
  std::vector<PointObservation> point_observations;
  std::vector<PlaneObservation> plane_observations;
  std::vector<ObjectObservation> object_observations;
  std::vector<RelativePose> relative_poses;
};

struct BundleOptions {
  int first_iterations = 5;
  int iterations = 10;
  bool reject = true;
  int dense_cameras = 60;
  bool pose_covariances = false;
  bool plane_covariances = false;
  bool point_covariances = false;
  PlaneNoise plane_noise;

  void visit(OptionVisitor& v) {
    v.field("first_iterations", first_iterations, {1, 1000}, "",
            "before outliers are rejected, at most; ORB-SLAM2: 5");
    v.field("iterations", iterations, {1, 1000}, "", "after that, at most; ORB-SLAM2: 10");
    v.field("reject", reject,
            "leave observations out of the second round that fail the 95 % chi-squared test");
    v.field("dense_cameras", dense_cameras, {1, 1000}, "",
            "up to so many free cameras the reduced system is solved densely");
    v.field("pose_covariances", pose_covariances, "compute the cameras' covariances");
    v.field("plane_covariances", plane_covariances, "compute the planes' covariances");
    v.field("point_covariances", point_covariances, "compute the points' covariances");
    v.group("plane_noise", plane_noise);
  }
  void validate() const { validate_fields(*this, "BundleOptions"); }
};

struct BundleSummary {
  std::vector<std::uint8_t> point_inlier;  // 1 or 0 for each observation
  std::vector<std::uint8_t> plane_inlier;
  std::vector<std::uint8_t> object_inlier;
  int iterations = 0;
  bool converged = false;      // the last round ended by itself, not by its limit
  double initial_cost = 0.0;   // half the robust sum of squares of all observations
  double final_cost = 0.0;     // of the inliers and the relative poses
  double chi_squared = 0.0;    // of the inliers and the relative poses
  int degrees_of_freedom = 0;  // their dimensions less the free parameters they determine
  /// On request, one for each camera, plane and point; zero for what is fixed, NaN for what no
  /// inlier determines.
  std::vector<Matrix6d> pose_covariances;          // of the increment, see tangent.hpp
  std::vector<Eigen::Matrix3d> plane_covariances;  // of (tilt, tilt, distance) in
                                                   // plane::tangent_basis(normal_world)
  std::vector<Eigen::Matrix3d> point_covariances;
};

/// Moves all that is free to the least robust sum of squares, in place, in two rounds: all
/// observations under Huber's kernel, then the inliers of the 95 % chi-squared test. Ceres with
/// one thread and no time limit: the same bits each time. Throws Error on values that are not
/// finite, indices out of range, variances that are not positive, or when no camera is fixed.
BundleSummary optimise(BundleProblem& problem, const CameraModel& camera,
                       const BundleOptions& options = {});

}  // namespace weft::slam
