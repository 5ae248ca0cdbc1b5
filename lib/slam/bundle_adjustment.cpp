#include "slam/bundle_adjustment.hpp"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <string>

#include "base/error.hpp"
#include "slam/bundle_covariance.hpp"
#include "slam/ceres_costs.hpp"
#include "slam/chi_squared.hpp"

namespace weft::slam {
namespace {

void check_index(int index, std::size_t count, const char* what, const std::string& where) {
  if (index < 0 || static_cast<std::size_t>(index) >= count) {
    throw Error(where + " refers to " + what + " " + std::to_string(index) + " of " +
                std::to_string(count));
  }
}

void check(const BundleProblem& problem, const CameraModel& camera) {
  camera.validate("the camera of the bundle adjustment");
  const auto named = [](const char* what, std::size_t i) { return what + std::to_string(i); };
  for (std::size_t i = 0; i < problem.cameras.size(); ++i) {
    check_pose(problem.cameras[i].T_camera_world, named("camera ", i));
  }
  for (std::size_t i = 0; i < problem.points.size(); ++i) {
    if (!problem.points[i].position_world.allFinite()) {
      throw Error(named("point ", i) + " is not finite");
    }
  }
  for (std::size_t i = 0; i < problem.planes.size(); ++i) {
    check_plane(problem.planes[i], named("plane ", i));
  }
  for (std::size_t i = 0; i < problem.objects.size(); ++i) {
    check_pose(problem.objects[i].T_world_object, named("object ", i));
  }
  for (std::size_t i = 0; i < problem.point_observations.size(); ++i) {
    const auto& seen = problem.point_observations[i];
    check_observation(seen, problem.points.size(), named("point observation ", i));
    check_index(seen.camera, problem.cameras.size(), "camera", named("point observation ", i));
  }
  for (std::size_t i = 0; i < problem.plane_observations.size(); ++i) {
    const auto& seen = problem.plane_observations[i];
    check_observation(seen, problem.planes.size(), named("plane observation ", i));
    check_index(seen.camera, problem.cameras.size(), "camera", named("plane observation ", i));
  }
  for (std::size_t i = 0; i < problem.object_observations.size(); ++i) {
    const auto& seen = problem.object_observations[i];
    check_pose(seen.T_camera_object, named("object observation ", i));
    check_index(seen.object, problem.objects.size(), "object", named("object observation ", i));
    check_index(seen.camera, problem.cameras.size(), "camera", named("object observation ", i));
  }
  for (std::size_t i = 0; i < problem.relative_poses.size(); ++i) {
    const auto& edge = problem.relative_poses[i];
    check_pose(edge.T_a_b, named("relative pose ", i));
    check_index(edge.camera_a, problem.cameras.size(), "camera", named("relative pose ", i));
    check_index(edge.camera_b, problem.cameras.size(), "camera", named("relative pose ", i));
    if (edge.camera_a == edge.camera_b) {
      throw Error(named("relative pose ", i) + " relates camera " + std::to_string(edge.camera_a) +
                  " to itself");
    }
  }
  if (std::none_of(problem.cameras.begin(), problem.cameras.end(),
                   [](const CameraState& c) { return c.fixed; })) {
    throw Error("bundle adjustment: no camera is fixed; fix the first, or one that is known well");
  }
}

/// The problem's numbers as Ceres moves them.
class Adjustment {
 public:
  Adjustment(BundleProblem& problem, const CameraModel& camera, const BundleOptions& options)
      : problem_(problem), camera_(camera), options_(options) {
    for (const auto& c : problem.cameras) cameras_.push_back(to_block(c.T_camera_world));
    for (const auto& o : problem.objects) objects_.push_back(to_block(o.T_world_object));
    for (const auto& p : problem.planes) {
      const Eigen::Vector3d n = p.normal_world.normalized();
      planes_.push_back({n.x(), n.y(), n.z(), p.distance_m});
    }
    for (std::size_t i = 0; i < problem.plane_observations.size(); ++i) {
      factors_.emplace_back(problem.plane_observations[i], options.plane_noise,
                            "plane observation " + std::to_string(i));
    }
    for (std::size_t i = 0; i < problem.object_observations.size(); ++i) {
      const auto& seen = problem.object_observations[i];
      object_costs_.emplace_back(
          object_residual, seen.T_camera_object,
          square_root(seen.information, "object observation " + std::to_string(i)));
    }
    for (std::size_t i = 0; i < problem.relative_poses.size(); ++i) {
      const auto& edge = problem.relative_poses[i];
      relative_costs_.emplace_back(
          relative_residual, edge.T_a_b,
          square_root(edge.information, "relative pose " + std::to_string(i)));
    }
    for (const auto& factor : factors_) plane_costs_.emplace_back(factor);
    for (const auto& seen : problem.point_observations) {
      if (seen.dimension() == 3) {
        with_depth_.emplace_back(camera, seen);
      } else {
        without_depth_.emplace_back(camera, seen);
      }
    }
  }

  /// One round over the observations with flag 1.
  ceres::Solver::Summary solve(const BundleSummary& flags, int iterations) {
    ceres::Problem::Options ownership;
    ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem solved(ownership);
    std::vector<char> camera_used(cameras_.size(), 0), object_used(objects_.size(), 0);
    std::vector<char> point_used(problem_.points.size(), 0), plane_used(planes_.size(), 0);

    auto with_depth = with_depth_.begin();
    auto without_depth = without_depth_.begin();
    for (std::size_t i = 0; i < problem_.point_observations.size(); ++i) {
      const auto& seen = problem_.point_observations[i];
      const bool has_depth = seen.dimension() == 3;
      ceres::CostFunction* cost =
          has_depth ? static_cast<ceres::CostFunction*>(&*with_depth++) : &*without_depth++;
      const auto camera = static_cast<std::size_t>(seen.camera);
      const auto point = static_cast<std::size_t>(seen.point);
      if (!flags.point_inlier[i]) continue;
      if (problem_.cameras[camera].fixed && problem_.points[point].fixed) continue;
      camera_used[camera] = point_used[point] = 1;
      solved.AddResidualBlock(cost, has_depth ? &huber_3_ : &huber_2_, cameras_[camera].data(),
                              problem_.points[point].position_world.data());
    }
    for (std::size_t i = 0; i < problem_.plane_observations.size(); ++i) {
      const auto& seen = problem_.plane_observations[i];
      const auto camera = static_cast<std::size_t>(seen.camera);
      const auto plane = static_cast<std::size_t>(seen.plane);
      if (!flags.plane_inlier[i]) continue;
      if (problem_.cameras[camera].fixed && problem_.planes[plane].fixed) continue;
      camera_used[camera] = plane_used[plane] = 1;
      solved.AddResidualBlock(&plane_costs_[i], &huber_3_, cameras_[camera].data(),
                              planes_[plane].data());
    }
    for (std::size_t i = 0; i < problem_.object_observations.size(); ++i) {
      const auto& seen = problem_.object_observations[i];
      const auto camera = static_cast<std::size_t>(seen.camera);
      const auto object = static_cast<std::size_t>(seen.object);
      if (!flags.object_inlier[i]) continue;
      camera_used[camera] = object_used[object] = 1;
      solved.AddResidualBlock(&object_costs_[i], &huber_6_, cameras_[camera].data(),
                              objects_[object].data());
    }
    for (std::size_t i = 0; i < problem_.relative_poses.size(); ++i) {
      const auto a = static_cast<std::size_t>(problem_.relative_poses[i].camera_a);
      const auto b = static_cast<std::size_t>(problem_.relative_poses[i].camera_b);
      camera_used[a] = camera_used[b] = 1;
      solved.AddResidualBlock(&relative_costs_[i], nullptr, cameras_[a].data(), cameras_[b].data());
    }

    // Points first: they are many and see only cameras. All else is left to the reduced system. A
    // group for each kind: Ceres takes a group's blocks in the order of their addresses, which for
    // blocks of one vector is theirs, but across vectors is the heap's.
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    int free_cameras = 0;
    bool free_points = false;
    const auto add = [&](double* block, bool fixed, int group) {
      ordering->AddElementToGroup(block, group);
      if (fixed) solved.SetParameterBlockConstant(block);
    };
    for (std::size_t i = 0; i < point_used.size(); ++i) {
      if (!point_used[i]) continue;
      add(problem_.points[i].position_world.data(), problem_.points[i].fixed, 0);
      free_points = free_points || !problem_.points[i].fixed;
    }
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      if (!camera_used[i]) continue;
      solved.SetManifold(cameras_[i].data(), &pose_manifold_);
      add(cameras_[i].data(), problem_.cameras[i].fixed, 1);
      free_cameras += !problem_.cameras[i].fixed;
    }
    for (std::size_t i = 0; i < planes_.size(); ++i) {
      if (!plane_used[i]) continue;
      solved.SetManifold(planes_[i].data(), &plane_manifold_);
      add(planes_[i].data(), problem_.planes[i].fixed, 2);
    }
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      if (!object_used[i]) continue;
      solved.SetManifold(objects_[i].data(), &pose_manifold_);
      add(objects_[i].data(), problem_.objects[i].fixed, 3);
    }

    ceres::Solver::Options how;
    how.max_num_iterations = iterations;
    how.num_threads = 1;
    how.logging_type = ceres::SILENT;
    // Not SuiteSparse: it calls a BLAS whose bits depend on its own threads.
    how.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
    how.linear_solver_type = !free_points ? ceres::SPARSE_NORMAL_CHOLESKY
                             : free_cameras <= options_.dense_cameras ? ceres::DENSE_SCHUR
                                                                      : ceres::SPARSE_SCHUR;
    if (free_points) how.linear_solver_ordering = ordering;
    ceres::Solver::Summary summary;
    ceres::Solve(how, &solved, &summary);
    if (summary.termination_type == ceres::FAILURE) {
      throw Error("bundle adjustment: " + summary.message);
    }
    return summary;
  }

  void store() {
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      if (!problem_.cameras[i].fixed) {
        problem_.cameras[i].T_camera_world = to_pose(cameras_[i].data());
        problem_.cameras[i].T_camera_world.rotation.normalize();
      }
    }
    for (std::size_t i = 0; i < objects_.size(); ++i) {
      if (!problem_.objects[i].fixed) {
        problem_.objects[i].T_world_object = to_pose(objects_[i].data());
        problem_.objects[i].T_world_object.rotation.normalize();
      }
    }
    for (std::size_t i = 0; i < planes_.size(); ++i) {
      if (problem_.planes[i].fixed) continue;
      problem_.planes[i].normal_world =
          Eigen::Map<const Eigen::Vector3d>(planes_[i].data()).normalized();
      problem_.planes[i].distance_m = planes_[i][3];
    }
  }

  /// The chi-squared of each observation at the stored numbers; sorts them where `reject`.
  void classify(BundleSummary& summary, bool reject) const {
    summary.chi_squared = 0.0;
    summary.degrees_of_freedom = 0;
    std::vector<int> point_dimensions(problem_.points.size(), 0);
    std::vector<char> camera_used(cameras_.size(), 0), plane_used(planes_.size(), 0),
        object_used(objects_.size(), 0);
    std::vector<Eigen::Matrix3d> R;
    for (const auto& c : problem_.cameras)
      R.push_back(c.T_camera_world.rotation.toRotationMatrix());
    const auto judge = [&](double squared, int dimension, bool possible, std::uint8_t& inlier) {
      if (reject) inlier = possible && squared <= chi_squared_95(dimension);
      if (!inlier) return false;
      summary.chi_squared += squared;
      summary.degrees_of_freedom += dimension;
      return true;
    };
    for (std::size_t i = 0; i < problem_.point_observations.size(); ++i) {
      const auto& seen = problem_.point_observations[i];
      const auto camera = static_cast<std::size_t>(seen.camera);
      const auto point = static_cast<std::size_t>(seen.point);
      const PointResidual r =
          point_residual(camera_, seen,
                         R[camera] * problem_.points[point].position_world +
                             problem_.cameras[camera].T_camera_world.translation);
      if (!judge(r.e.squaredNorm(), seen.dimension(), r.in_front, summary.point_inlier[i]))
        continue;
      camera_used[camera] = 1;
      point_dimensions[point] += seen.dimension();
    }
    for (std::size_t i = 0; i < factors_.size(); ++i) {
      const auto& seen = problem_.plane_observations[i];
      const auto camera = static_cast<std::size_t>(seen.camera);
      const auto plane = static_cast<std::size_t>(seen.plane);
      const PlaneResidual r = plane_residual(
          factors_[i], R[camera], problem_.cameras[camera].T_camera_world.translation,
          problem_.planes[plane].normal_world, problem_.planes[plane].distance_m);
      if (judge((factors_[i].whitener * r.e).squaredNorm(), 3, true, summary.plane_inlier[i])) {
        camera_used[camera] = plane_used[plane] = 1;
      }
    }
    for (std::size_t i = 0; i < problem_.object_observations.size(); ++i) {
      const auto& seen = problem_.object_observations[i];
      const auto camera = static_cast<std::size_t>(seen.camera);
      const auto object = static_cast<std::size_t>(seen.object);
      const Vector6d e =
          object_residual(seen.T_camera_object, problem_.cameras[camera].T_camera_world,
                          problem_.objects[object].T_world_object)
              .e;
      if (judge(e.dot(seen.information * e), 6, true, summary.object_inlier[i])) {
        camera_used[camera] = object_used[object] = 1;
      }
    }
    for (const auto& edge : problem_.relative_poses) {
      const auto a = static_cast<std::size_t>(edge.camera_a);
      const auto b = static_cast<std::size_t>(edge.camera_b);
      const Vector6d e = relative_residual(edge.T_a_b, problem_.cameras[a].T_camera_world,
                                           problem_.cameras[b].T_camera_world)
                             .e;
      summary.chi_squared += e.dot(edge.information * e);
      summary.degrees_of_freedom += 6;
      camera_used[a] = camera_used[b] = 1;
    }
    for (std::size_t i = 0; i < camera_used.size(); ++i) {
      summary.degrees_of_freedom -= camera_used[i] && !problem_.cameras[i].fixed ? 6 : 0;
    }
    for (std::size_t i = 0; i < object_used.size(); ++i) {
      summary.degrees_of_freedom -= object_used[i] && !problem_.objects[i].fixed ? 6 : 0;
    }
    for (std::size_t i = 0; i < plane_used.size(); ++i) {
      summary.degrees_of_freedom -= plane_used[i] && !problem_.planes[i].fixed ? 3 : 0;
    }
    for (std::size_t i = 0; i < point_dimensions.size(); ++i) {
      if (!problem_.points[i].fixed) summary.degrees_of_freedom -= std::min(3, point_dimensions[i]);
    }
  }

  const std::vector<PlaneFactor>& factors() const { return factors_; }

 private:
  BundleProblem& problem_;
  const CameraModel& camera_;
  const BundleOptions& options_;
  std::vector<PoseBlock> cameras_, objects_;
  std::vector<PlaneBlock> planes_;
  std::vector<PlaneFactor> factors_;
  std::deque<PointCost<3>> with_depth_;
  std::deque<PointCost<2>> without_depth_;
  std::deque<PlaneCost> plane_costs_;
  std::deque<PairCost> object_costs_, relative_costs_;
  PoseManifold pose_manifold_;
  PlaneManifold plane_manifold_;
  ceres::HuberLoss huber_2_{std::sqrt(chi_squared_95(2))};
  ceres::HuberLoss huber_3_{std::sqrt(chi_squared_95(3))};
  ceres::HuberLoss huber_6_{std::sqrt(chi_squared_95(6))};
};

}  // namespace

BundleSummary optimise(BundleProblem& problem, const CameraModel& camera,
                       const BundleOptions& options) {
  options.validate();
  check(problem, camera);
  Adjustment adjustment(problem, camera, options);
  BundleSummary out;
  out.point_inlier.assign(problem.point_observations.size(), 1);
  out.plane_inlier.assign(problem.plane_observations.size(), 1);
  out.object_inlier.assign(problem.object_observations.size(), 1);
  for (int round = 0; round < (options.reject ? 2 : 1); ++round) {
    const auto solved = adjustment.solve(
        out, options.reject && round == 0 ? options.first_iterations : options.iterations);
    adjustment.store();
    adjustment.classify(out, options.reject);
    if (round == 0) out.initial_cost = solved.initial_cost;
    out.final_cost = solved.final_cost;
    out.iterations += static_cast<int>(solved.iterations.size()) - 1;
    out.converged = solved.termination_type == ceres::CONVERGENCE;
  }
  if (options.pose_covariances || options.plane_covariances || options.point_covariances) {
    add_covariances(problem, camera, adjustment.factors(), options, out);
  }
  return out;
}

}  // namespace weft::slam
