#include "slam/pose_graph.hpp"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <deque>
#include <string>

#include "base/error.hpp"
#include "slam/ceres_costs.hpp"

namespace weft::slam {

PoseGraphSummary optimise_pose_graph(std::vector<CameraState>& cameras,
                                     const std::vector<RelativePose>& edges,
                                     const PoseGraphOptions& options) {
  options.validate();
  const auto count = static_cast<int>(cameras.size());
  std::vector<PoseBlock> blocks;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    check_pose(cameras[i].T_camera_world, "camera " + std::to_string(i));
    blocks.push_back(to_block(cameras[i].T_camera_world));
  }
  if (std::none_of(cameras.begin(), cameras.end(), [](const auto& c) { return c.fixed; })) {
    throw Error("pose graph: no camera is fixed; fix the first, or one that is known well");
  }
  PoseManifold manifold;
  ceres::HuberLoss huber(std::max(options.huber, 1e-12));
  std::deque<PairCost> costs;
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const RelativePose& edge = edges[i];
    const std::string where = "edge " + std::to_string(i);
    check_pose(edge.T_a_b, where);
    if (edge.camera_a < 0 || edge.camera_b < 0 || edge.camera_a >= count ||
        edge.camera_b >= count || edge.camera_a == edge.camera_b) {
      throw Error(where + " of the pose graph relates cameras " + std::to_string(edge.camera_a) +
                  " and " + std::to_string(edge.camera_b) + " of " + std::to_string(count));
    }
    costs.emplace_back(relative_residual, edge.T_a_b, square_root(edge.information, where));
    problem.AddResidualBlock(&costs.back(), options.huber > 0.0 ? &huber : nullptr,
                             blocks[static_cast<std::size_t>(edge.camera_a)].data(),
                             blocks[static_cast<std::size_t>(edge.camera_b)].data());
  }
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (!problem.HasParameterBlock(blocks[i].data())) continue;
    problem.SetManifold(blocks[i].data(), &manifold);
    if (cameras[i].fixed) problem.SetParameterBlockConstant(blocks[i].data());
  }
  ceres::Solver::Options how;
  how.max_num_iterations = options.iterations;
  how.num_threads = 1;
  how.logging_type = ceres::SILENT;
  how.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  // Not SuiteSparse: it calls a BLAS whose bits depend on its own threads.
  how.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  ceres::Solver::Summary solved;
  ceres::Solve(how, &problem, &solved);
  if (solved.termination_type == ceres::FAILURE) throw Error("pose graph: " + solved.message);

  PoseGraphSummary out;
  out.iterations = std::max(0, static_cast<int>(solved.iterations.size()) - 1);
  out.converged = solved.termination_type == ceres::CONVERGENCE;
  out.initial_cost = solved.initial_cost;
  out.final_cost = solved.final_cost;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i].fixed) continue;
    cameras[i].T_camera_world = to_pose(blocks[i].data());
    cameras[i].T_camera_world.rotation.normalize();
  }
  for (const RelativePose& edge : edges) {
    const Vector6d e =
        relative_residual(edge.T_a_b,
                          cameras[static_cast<std::size_t>(edge.camera_a)].T_camera_world,
                          cameras[static_cast<std::size_t>(edge.camera_b)].T_camera_world)
            .e;
    out.chi_squared.push_back(e.dot(edge.information * e));
  }
  return out;
}

}  // namespace weft::slam
