#include "slam/ceres_costs.hpp"

namespace weft::slam {
namespace {

template <int Rows, int Columns>
using RowMajor = Eigen::Matrix<double, Rows, Columns, Eigen::RowMajor>;
template <int Rows, int Columns>
using MapOf = Eigen::Map<RowMajor<Rows, Columns>>;

}  // namespace

PoseBlock to_block(const Rigid3d& pose) {
  const auto& q = pose.rotation;
  const auto& t = pose.translation;
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

Rigid3d to_pose(const double* block) {
  return {Eigen::Quaterniond(Eigen::Map<const Eigen::Vector4d>(block)),
          Eigen::Map<const Eigen::Vector3d>(block + 4)};
}

RowMajor<6, 7> increment_by_block(const double* block) {
  // dq = (w/2, 0) q for a small rotation vector w, so w = 2 vec(dq q*).
  const Eigen::Vector3d v(block[0], block[1], block[2]);
  RowMajor<6, 7> out = RowMajor<6, 7>::Zero();
  out.topLeftCorner<3, 3>() = 2.0 * (block[3] * Eigen::Matrix3d::Identity() + skew(v));
  out.block<3, 1>(0, 3) = -2.0 * v;
  out.bottomRightCorner<3, 3>().setIdentity();
  return out;
}

template <int Dimension>
bool PointCost<Dimension>::Evaluate(double const* const* parameters, double* residuals,
                                    double** jacobians) const {
  const Rigid3d pose = to_pose(parameters[0]);
  const Eigen::Map<const Eigen::Vector3d> point(parameters[1]);
  const Eigen::Matrix3d R = pose.rotation.toRotationMatrix();
  const Eigen::Vector3d turned = R * point;
  const PointResidual r = point_residual(camera_, seen_, turned + pose.translation);
  Eigen::Map<Eigen::Matrix<double, Dimension, 1>>{residuals} = r.e.template head<Dimension>();
  if (!jacobians) return true;
  const Eigen::Matrix<double, Dimension, 3> A = r.by_camera_point.template topRows<Dimension>();
  if (jacobians[0]) {
    MapOf<Dimension, 7> J(jacobians[0]);
    // -A skew(turned) times the rows of increment_by_block
    const Eigen::Matrix<double, Dimension, 3> by_turn = -2.0 * A * skew(turned);
    const Eigen::Map<const Eigen::Vector3d> v(parameters[0]);
    J.template leftCols<3>() = parameters[0][3] * by_turn + by_turn * skew(v);
    J.col(3) = -by_turn * v;
    J.template rightCols<3>() = A;
  }
  if (jacobians[1]) MapOf<Dimension, 3>{jacobians[1]} = A * R;
  return true;
}
template class PointCost<2>;
template class PointCost<3>;

bool PlaneCost::Evaluate(double const* const* parameters, double* residuals,
                         double** jacobians) const {
  const Rigid3d pose = to_pose(parameters[0]);
  const Eigen::Map<const Eigen::Vector3d> normal(parameters[1]);
  const PlaneResidual r = plane_residual(factor_, pose.rotation.toRotationMatrix(),
                                         pose.translation, normal, parameters[1][3]);
  Eigen::Map<Eigen::Vector3d>{residuals} = factor_.whitener * r.e;
  if (!jacobians) return true;
  if (jacobians[0]) {
    MapOf<3, 7>{jacobians[0]} = factor_.whitener * r.by_pose * increment_by_block(parameters[0]);
  }
  if (jacobians[1]) MapOf<3, 4>{jacobians[1]} = factor_.whitener * r.by_plane;
  return true;
}

bool PairCost::Evaluate(double const* const* parameters, double* residuals,
                        double** jacobians) const {
  const PairResidual r = residual_(measured_, to_pose(parameters[0]), to_pose(parameters[1]));
  Eigen::Map<Vector6d>{residuals} = root_information_ * r.e;
  if (!jacobians) return true;
  if (jacobians[0]) {
    MapOf<6, 7>{jacobians[0]} = root_information_ * r.by_first * increment_by_block(parameters[0]);
  }
  if (jacobians[1]) {
    MapOf<6, 7>{jacobians[1]} = root_information_ * r.by_second * increment_by_block(parameters[1]);
  }
  return true;
}

}  // namespace weft::slam
