#pragma once

#include <vector>

#include "slam/bundle_adjustment.hpp"

namespace weft::slam {

struct PoseGraphOptions {
  int iterations = 20;
  double huber = 0.0;

  void visit(OptionVisitor& v) {
    v.field("iterations", iterations, {1, 1000}, "", "at most; ORB-SLAM2's essential graph: 20");
    v.field("huber", huber, {0.0, 1e6}, "",
            "edges with a Mahalanobis distance above this count linearly; 0: none do");
  }
  void validate() const { validate_fields(*this, "PoseGraphOptions"); }
};

struct PoseGraphSummary {
  int iterations = 0;
  bool converged = false;
  double initial_cost = 0.0;  // half the sum of squares
  double final_cost = 0.0;
  std::vector<double> chi_squared;  // of each edge at the end
};

/// Moves the free cameras to the least sum of squares of all edges, in place; scale is fixed (SE3).
/// What closes a loop. Throws Error as optimise() does.
PoseGraphSummary optimise_pose_graph(std::vector<CameraState>& cameras,
                                     const std::vector<RelativePose>& edges,
                                     const PoseGraphOptions& options = {});

}  // namespace weft::slam
