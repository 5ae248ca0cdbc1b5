#include "slam/pose_optimiser.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <string>

#include "base/error.hpp"
#include "slam/chi_squared.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

struct Normals {
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0.0;  // half the robust sum of squares
};

class PoseProblem {
 public:
  PoseProblem(const CameraModel& camera, std::span<const Eigen::Vector3d> points,
              std::span<const PlaneState> planes, std::span<const PointObservation> seen_points,
              std::span<const PlaneObservation> seen_planes, const PoseOptions& options,
              const std::optional<PosePrior>& prior)
      : camera_(camera),
        points_(points),
        planes_(planes),
        seen_points_(seen_points),
        seen_planes_(seen_planes),
        prior_(prior),
        point_active(seen_points.size(), 1),
        plane_active(seen_planes.size(), 1) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!points[i].allFinite()) throw Error("point " + std::to_string(i) + " is not finite");
    }
    for (std::size_t i = 0; i < planes.size(); ++i) {
      check_plane(planes[i], "plane " + std::to_string(i));
    }
    for (std::size_t i = 0; i < seen_points.size(); ++i) {
      check_observation(seen_points[i], points.size(), "point observation " + std::to_string(i));
    }
    factors_.reserve(seen_planes.size());
    for (std::size_t i = 0; i < seen_planes.size(); ++i) {
      const std::string where = "plane observation " + std::to_string(i);
      check_observation(seen_planes[i], planes.size(), where);
      factors_.emplace_back(seen_planes[i], options.plane_noise, where);
    }
    if (prior_) {
      check_pose(prior_->T_camera_world, "the prior");
      if (!prior_->information.allFinite()) throw Error("the prior's information is not finite");
    }
  }

  /// Normal equations of the active observations at a pose.
  Normals evaluate(const Rigid3d& pose, bool robust) const {
    Normals sum;
    const Eigen::Matrix3d R = pose.rotation.toRotationMatrix();
    Eigen::Matrix3d ww = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d wt = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d tt = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gw = Eigen::Vector3d::Zero();
    Eigen::Vector3d gt = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < seen_points_.size(); ++i) {
      if (!point_active[i]) continue;
      const PointObservation& seen = seen_points_[i];
      const Eigen::Vector3d turned = R * points_[static_cast<std::size_t>(seen.point)];
      const PointResidual r = point_residual(camera_, seen, turned + pose.translation);
      const double weight = add_cost(r.e.squaredNorm(), seen.dimension(), robust, sum.cost);
      // The point moves by w x turned + v: everything follows from A^T A and A^T e.
      const Eigen::Matrix3d weighted = weight * r.by_camera_point.transpose();
      const Eigen::Matrix3d inner = weighted * r.by_camera_point;
      const Eigen::Vector3d pull = weighted * r.e;
      const Eigen::Matrix3d cross = skew(turned);
      const Eigen::Matrix3d crossed = cross * inner;
      ww.noalias() -= crossed * cross;
      wt += crossed;
      tt += inner;
      gw += turned.cross(pull);
      gt += pull;
    }
    sum.information << ww, wt, wt.transpose(), tt;
    sum.gradient << gw, gt;
    for (std::size_t i = 0; i < factors_.size(); ++i) {
      if (!plane_active[i]) continue;
      const PlaneState& plane = planes_[static_cast<std::size_t>(seen_planes_[i].plane)];
      const PlaneResidual r =
          plane_residual(factors_[i], R, pose.translation, plane.normal_world, plane.distance_m);
      const Eigen::Vector3d e = factors_[i].whitener * r.e;
      const Matrix36d by_pose = factors_[i].whitener * r.by_pose;
      const double weight = add_cost(e.squaredNorm(), 3, robust, sum.cost);
      sum.information.noalias() += weight * by_pose.transpose() * by_pose;
      sum.gradient.noalias() += weight * by_pose.transpose() * e;
    }
    if (prior_) {
      const Vector6d e = minus(pose, prior_->T_camera_world);
      Matrix6d by_pose = Matrix6d::Identity();
      by_pose.topLeftCorner<3, 3>() = left_jacobian_inverse(e.head<3>());
      sum.cost += 0.5 * e.dot(prior_->information * e);
      sum.information += by_pose.transpose() * prior_->information * by_pose;
      sum.gradient += by_pose.transpose() * prior_->information * e;
    }
    return sum;
  }

  /// Sorts all observations by the chi-squared test; adds up the inliers.
  void classify(const Rigid3d& pose, PoseResult& result) {
    result.chi_squared = 0.0;
    result.degrees_of_freedom = 0;
    result.point_inliers = result.plane_inliers = 0;
    const Eigen::Matrix3d R = pose.rotation.toRotationMatrix();
    for (std::size_t i = 0; i < seen_points_.size(); ++i) {
      const PointObservation& seen = seen_points_[i];
      const PointResidual r = point_residual(
          camera_, seen, R * points_[static_cast<std::size_t>(seen.point)] + pose.translation);
      const double squared = r.e.squaredNorm();
      point_active[i] = r.in_front && squared <= chi_squared_95(seen.dimension());
      if (!point_active[i]) continue;
      ++result.point_inliers;
      result.chi_squared += squared;
      result.degrees_of_freedom += seen.dimension();
    }
    for (std::size_t i = 0; i < factors_.size(); ++i) {
      const PlaneState& plane = planes_[static_cast<std::size_t>(seen_planes_[i].plane)];
      const PlaneResidual r =
          plane_residual(factors_[i], R, pose.translation, plane.normal_world, plane.distance_m);
      const double squared = (factors_[i].whitener * r.e).squaredNorm();
      plane_active[i] = squared <= chi_squared_95(3);
      if (!plane_active[i]) continue;
      ++result.plane_inliers;
      result.chi_squared += squared;
      result.degrees_of_freedom += 3;
    }
  }

 private:
  /// Huber's kernel at the 95 % quantile; returns the weight.
  static double add_cost(double squared, int dimension, bool robust, double& cost) {
    const double limit = chi_squared_95(dimension);
    if (!robust || squared <= limit) {
      cost += 0.5 * squared;
      return 1.0;
    }
    const double root = std::sqrt(limit * squared);
    cost += root - 0.5 * limit;
    return limit / root;
  }

  const CameraModel& camera_;
  std::span<const Eigen::Vector3d> points_;
  std::span<const PlaneState> planes_;
  std::span<const PointObservation> seen_points_;
  std::span<const PlaneObservation> seen_planes_;
  const std::optional<PosePrior>& prior_;
  std::vector<PlaneFactor> factors_;

 public:
  std::vector<std::uint8_t> point_active;
  std::vector<std::uint8_t> plane_active;
};

}  // namespace

PoseResult optimise_pose(const CameraModel& camera, const Rigid3d& start,
                         std::span<const Eigen::Vector3d> points_world,
                         std::span<const PlaneState> planes,
                         std::span<const PointObservation> point_observations,
                         std::span<const PlaneObservation> plane_observations,
                         const PoseOptions& options, const std::optional<PosePrior>& prior) {
  options.validate();
  camera.validate("the camera of the pose");
  check_pose(start, "the start");
  PoseProblem problem(camera, points_world, planes, point_observations, plane_observations, options,
                      prior);
  const double least = 1.0 / (options.unobserved_sigma * options.unobserved_sigma);
  PoseResult result;
  Rigid3d pose = start;
  for (int round = 0; round < options.rounds; ++round) {
    const bool robust = round + 1 < options.rounds;
    Normals now = problem.evaluate(pose, robust);
    double damping = 0.0;  // Gauss-Newton until a step fails; relative to the mean information
    for (int i = 0; i < options.iterations; ++i) {
      ++result.iterations;
      const Eigen::SelfAdjointEigenSolver<Matrix6d> modes(now.information);
      const Vector6d along = modes.eigenvectors().transpose() * now.gradient;
      Vector6d step = Vector6d::Zero();
      for (int k = 0; k < 6; ++k) {
        const double information = modes.eigenvalues()[k];
        if (information < least) continue;
        step -= along[k] / (information + damping * now.information.trace() / 6.0) *
                modes.eigenvectors().col(k);
      }
      const Rigid3d moved = plus(pose, step);
      const Normals next = problem.evaluate(moved, robust);
      if (next.cost > now.cost) {
        damping = std::max(1e-3, 10.0 * damping);
        if (step.norm() < 1e-9) break;
        continue;
      }
      const double gain = now.cost - next.cost;
      pose = moved;
      now = next;
      damping *= 0.1;
      if (damping < 1e-4) damping = 0.0;
      if (step.norm() < 1e-9 || gain <= 1e-7 * now.cost) break;
    }
    problem.classify(pose, result);
  }
  result.T_camera_world = pose;
  result.point_inlier = problem.point_active;
  result.plane_inlier = problem.plane_active;
  result.information = problem.evaluate(pose, false).information;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> modes(result.information, Eigen::EigenvaluesOnly);
  result.observed_directions = static_cast<int>((modes.eigenvalues().array() >= least).count());
  result.degrees_of_freedom = std::max(0, result.degrees_of_freedom - result.observed_directions);
  return result;
}

}  // namespace weft::slam
