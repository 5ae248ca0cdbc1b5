#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "base/options.hpp"
#include "plane/extractor.hpp"
#include "slam/observations.hpp"

namespace weft::slam {

struct PlaneMatchOptions {
  double max_angle_deg = 30.0;
  double max_distance_m = 0.1;
  double max_chi_squared = 16.27;
  PlaneNoise noise;

  void visit(OptionVisitor& v) {
    v.field("max_angle_deg", max_angle_deg, {0.1, 89.0}, "deg",
            "between the normals (garment-slam.txt 3.5.2)");
    v.field("max_distance_m", max_distance_m, {1e-3, 10.0}, "m",
            "mean distance of the segment's points from the known plane (garment-slam.txt 3.5.2 "
            "takes the known plane's points and the segment's plane, which says nothing far from "
            "a small segment)");
    v.field("max_chi_squared", max_chi_squared, {0.1, 1e6}, "",
            "of the difference under both planes' and the pose's covariances, so that what is "
            "known well is not matched loosely: a folded garment is not the table it lies on. "
            "16.27: 99.9 % of three degrees of freedom");
    v.group("noise", noise);
  }
  void validate() const { validate_fields(*this, "PlaneMatchOptions"); }
};

/// A plane that may be seen again.
struct KnownPlane {
  PlaneState state;                                      // its normal to the side it is seen from
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // see covariance_in_world
};

/// For each segment the index of the known plane it is, or -1: the assignment of least total
/// chi-squared distance among the pairs that pass all three gates, each known plane to one segment
/// at most. pose_covariance: of minus(T, T_camera_world). Throws Error on values that are not
/// finite.
std::vector<int> match_planes(std::span<const plane::PlaneSegment> segments,
                              std::span<const KnownPlane> known, const Rigid3d& T_camera_world,
                              const Matrix6d& pose_covariance, const PlaneMatchOptions& options);

}  // namespace weft::slam
