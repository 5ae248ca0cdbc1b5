#include "slam/bundle_covariance.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <limits>

#include "plane/extractor.hpp"

namespace weft::slam {
namespace {

using Matrix63d = Eigen::Matrix<double, 6, 3>;

/// A free point's information and what ties it to the free cameras that see it.
struct PointBlock {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  std::vector<std::pair<int, Matrix63d>> ties;  // offset of the camera's unknowns
  Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero();
  bool determined = false;
};

/// Inverse of a symmetric matrix scaled to ones on its diagonal; false when it is not positive
/// definite by a margin.
bool invert(const Eigen::MatrixXd& information, Eigen::MatrixXd& inverse) {
  const Eigen::VectorXd diagonal = information.diagonal();
  if (!(diagonal.minCoeff() > 0.0)) return false;
  const Eigen::VectorXd scale = diagonal.cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> decomposition(scaled);
  if (decomposition.info() != Eigen::Success) return false;
  if (!(decomposition.matrixLLT().diagonal().minCoeff() > 1e-7)) return false;
  inverse = scale.asDiagonal() *
            decomposition.solve(Eigen::MatrixXd::Identity(information.rows(), information.cols())) *
            scale.asDiagonal();
  return true;
}

/// Along a direction that nobody observes (one view without depth) the inverse is zero: there the
/// point tells nothing about the cameras either.
void invert(PointBlock& block) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> modes(block.information);
  const double least = 1e-12 * modes.eigenvalues()[2];
  block.determined = modes.eigenvalues()[0] > least;
  for (int k = 0; k < 3; ++k) {
    if (!(modes.eigenvalues()[k] > least)) continue;
    const Eigen::Vector3d mode = modes.eigenvectors().col(k);
    block.inverse += mode * mode.transpose() / modes.eigenvalues()[k];
  }
}

}  // namespace

void add_covariances(const BundleProblem& problem, const CameraModel& camera,
                     const std::vector<PlaneFactor>& factors, const BundleOptions& options,
                     BundleSummary& summary) {
  // The unknowns: free cameras, objects and planes that an inlier sees.
  constexpr int kFixed = -1, kUnseen = -2;
  std::vector<int> camera_at(problem.cameras.size(), kUnseen);
  std::vector<int> object_at(problem.objects.size(), kUnseen);
  std::vector<int> plane_at(problem.planes.size(), kUnseen);
  const auto mark = [](std::vector<int>& at, int index) {
    at[static_cast<std::size_t>(index)] = 0;
  };
  for (std::size_t i = 0; i < problem.point_observations.size(); ++i) {
    if (summary.point_inlier[i]) mark(camera_at, problem.point_observations[i].camera);
  }
  for (std::size_t i = 0; i < problem.plane_observations.size(); ++i) {
    if (!summary.plane_inlier[i]) continue;
    mark(camera_at, problem.plane_observations[i].camera);
    mark(plane_at, problem.plane_observations[i].plane);
  }
  for (std::size_t i = 0; i < problem.object_observations.size(); ++i) {
    if (!summary.object_inlier[i]) continue;
    mark(camera_at, problem.object_observations[i].camera);
    mark(object_at, problem.object_observations[i].object);
  }
  for (const auto& edge : problem.relative_poses) {
    mark(camera_at, edge.camera_a);
    mark(camera_at, edge.camera_b);
  }
  int unknowns = 0;
  const auto number = [&](std::vector<int>& at, const auto& states, int size) {
    for (std::size_t i = 0; i < at.size(); ++i) {
      if (states[i].fixed) {
        at[i] = kFixed;
      } else if (at[i] != kUnseen) {
        at[i] = unknowns;
        unknowns += size;
      }
    }
  };
  number(camera_at, problem.cameras, 6);
  number(object_at, problem.objects, 6);
  number(plane_at, problem.planes, 3);

  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(unknowns, unknowns);
  std::vector<PointBlock> points(problem.points.size());
  const auto add = [&](int i, const auto& Ji, int j, const auto& Jj) {
    if (i >= 0) information.block(i, i, Ji.cols(), Ji.cols()) += Ji.transpose() * Ji;
    if (j >= 0) information.block(j, j, Jj.cols(), Jj.cols()) += Jj.transpose() * Jj;
    if (i >= 0 && j >= 0) {
      const Eigen::MatrixXd cross = Ji.transpose() * Jj;
      information.block(i, j, Ji.cols(), Jj.cols()) += cross;
      information.block(j, i, Jj.cols(), Ji.cols()) += cross.transpose();
    }
  };
  for (std::size_t i = 0; i < problem.point_observations.size(); ++i) {
    if (!summary.point_inlier[i]) continue;
    const auto& seen = problem.point_observations[i];
    const Rigid3d& T = problem.cameras[static_cast<std::size_t>(seen.camera)].T_camera_world;
    const auto& point = problem.points[static_cast<std::size_t>(seen.point)];
    const Eigen::Matrix3d R = T.rotation.toRotationMatrix();
    const Eigen::Vector3d turned = R * point.position_world;
    const PointResidual r = point_residual(camera, seen, turned + T.translation);
    Matrix36d by_pose;
    by_pose << -r.by_camera_point * skew(turned), r.by_camera_point;
    const Eigen::Matrix3d by_point = r.by_camera_point * R;
    const int at = camera_at[static_cast<std::size_t>(seen.camera)];
    if (at >= 0) information.block<6, 6>(at, at) += by_pose.transpose() * by_pose;
    if (point.fixed) continue;
    PointBlock& block = points[static_cast<std::size_t>(seen.point)];
    block.information += by_point.transpose() * by_point;
    if (at >= 0) block.ties.emplace_back(at, by_pose.transpose() * by_point);
  }
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (!summary.plane_inlier[i]) continue;
    const auto& seen = problem.plane_observations[i];
    const Rigid3d& T = problem.cameras[static_cast<std::size_t>(seen.camera)].T_camera_world;
    const auto& plane = problem.planes[static_cast<std::size_t>(seen.plane)];
    const PlaneResidual r = plane_residual(factors[i], T.rotation.toRotationMatrix(), T.translation,
                                           plane.normal_world, plane.distance_m);
    const auto [e0, e1] = plane::tangent_basis(plane.normal_world);
    Eigen::Matrix3d by_plane;
    by_plane << r.by_plane.leftCols<3>() * e0, r.by_plane.leftCols<3>() * e1, r.by_plane.col(3);
    add(camera_at[static_cast<std::size_t>(seen.camera)],
        Matrix36d(factors[i].whitener * r.by_pose), plane_at[static_cast<std::size_t>(seen.plane)],
        Eigen::Matrix3d(factors[i].whitener * by_plane));
  }
  const auto add_pair = [&](const PairResidual& r, const Matrix6d& weight, int first, int second) {
    const Matrix6d root = square_root(weight, "a pose's observation");
    add(first, Matrix6d(root * r.by_first), second, Matrix6d(root * r.by_second));
  };
  for (std::size_t i = 0; i < problem.object_observations.size(); ++i) {
    if (!summary.object_inlier[i]) continue;
    const auto& seen = problem.object_observations[i];
    const auto c = static_cast<std::size_t>(seen.camera);
    const auto o = static_cast<std::size_t>(seen.object);
    add_pair(object_residual(seen.T_camera_object, problem.cameras[c].T_camera_world,
                             problem.objects[o].T_world_object),
             seen.information, camera_at[c], object_at[o]);
  }
  for (const auto& edge : problem.relative_poses) {
    const auto a = static_cast<std::size_t>(edge.camera_a);
    const auto b = static_cast<std::size_t>(edge.camera_b);
    add_pair(relative_residual(edge.T_a_b, problem.cameras[a].T_camera_world,
                               problem.cameras[b].T_camera_world),
             edge.information, camera_at[a], camera_at[b]);
  }

  for (PointBlock& block : points) invert(block);
  for (const PointBlock& block : points) {
    for (const auto& [i, tie_i] : block.ties) {
      const Matrix63d weighted = tie_i * block.inverse;
      for (const auto& [j, tie_j] : block.ties) {
        information.block<6, 6>(i, j) -= weighted * tie_j.transpose();
      }
    }
  }
  Eigen::MatrixXd covariance;
  const bool solved = unknowns == 0 || invert(information, covariance);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto fill = [&](const std::vector<int>& at, auto& out) {
    using Matrix = typename std::decay_t<decltype(out)>::value_type;
    constexpr int size = Matrix::RowsAtCompileTime;
    for (const int i : at) {
      if (i == kFixed) {
        out.push_back(Matrix::Zero());
      } else if (i == kUnseen || !solved) {
        out.push_back(Matrix::Constant(nan));
      } else {
        out.push_back(covariance.block<size, size>(i, i));
      }
    }
  };
  if (options.pose_covariances) fill(camera_at, summary.pose_covariances);
  if (options.plane_covariances) fill(plane_at, summary.plane_covariances);
  if (!options.point_covariances) return;
  for (std::size_t p = 0; p < points.size(); ++p) {
    const PointBlock& block = points[p];
    if (problem.points[p].fixed) {
      summary.point_covariances.push_back(Eigen::Matrix3d::Zero());
      continue;
    }
    if (!block.determined || !solved) {
      summary.point_covariances.push_back(Eigen::Matrix3d::Constant(nan));
      continue;
    }
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const auto& [i, tie_i] : block.ties) {
      for (const auto& [j, tie_j] : block.ties) {
        sum += tie_i.transpose() * covariance.block<6, 6>(i, j) * tie_j;
      }
    }
    summary.point_covariances.push_back(block.inverse + block.inverse * sum * block.inverse);
  }
}

}  // namespace weft::slam
