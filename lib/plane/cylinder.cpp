#include "plane/cylinder.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "base/det_math.hpp"
#include "base/random.hpp"
#include "plane/angle.hpp"

namespace weft::plane {
namespace {

constexpr int kHypotheses = 60;
using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

/// Least squares of point = foot + signed radius * normal, across the axis.
std::optional<Cylinder> through(const std::vector<OrientedPoint>& points,
                                const std::vector<int>& chosen, const Eigen::Vector3d& axis) {
  Eigen::Vector3d mean_point = Eigen::Vector3d::Zero(), mean_normal = mean_point;
  for (const int i : chosen) {
    mean_point += points[i].point;
    mean_normal += points[i].normal;
  }
  mean_point /= static_cast<double>(chosen.size());
  mean_normal /= static_cast<double>(chosen.size());
  const auto across = [&](const Eigen::Vector3d& v) -> Eigen::Vector3d {
    return v - axis * axis.dot(v);
  };
  double product = 0.0, square = 0.0;
  for (const int i : chosen) {
    const Eigen::Vector3d n = across(points[i].normal - mean_normal);
    product += n.dot(points[i].point - mean_point);
    square += n.squaredNorm();
  }
  if (!(square > 1e-6)) return std::nullopt;
  const double radius_m = product / square;
  Cylinder cylinder;
  cylinder.axis = axis;
  cylinder.point = mean_point - radius_m * across(mean_normal);
  cylinder.radius_m = std::abs(radius_m);
  cylinder.convex = radius_m > 0.0;
  return cylinder;
}

std::vector<int> inliers_of(const std::vector<OrientedPoint>& points, const Cylinder& cylinder,
                            double min_cos) {
  std::vector<int> inliers;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d from = points[i].point - cylinder.point;
    const Eigen::Vector3d radial = from - cylinder.axis * cylinder.axis.dot(from);
    const double length = radial.norm();
    if (!(std::abs(length - cylinder.radius_m) <= points[i].gate_m)) continue;
    const double cosine = points[i].normal.dot(radial) * (cylinder.convex ? 1.0 : -1.0);
    if (cosine >= min_cos * length) inliers.push_back(static_cast<int>(i));
  }
  return inliers;
}

/// Gauss-Newton on the distances from the surface, and on the normals across the axis with a lever
/// of half a radius, which holds the axis where the points lie on a short piece.
void refine(const std::vector<OrientedPoint>& points, const std::vector<int>& chosen,
            int iterations, Cylinder& cylinder) {
  for (int iteration = 0; iteration < iterations; ++iteration) {
    const Eigen::Vector3d e0 = cylinder.axis.unitOrthogonal(), e1 = cylinder.axis.cross(e0);
    const double lever = 0.5 * cylinder.radius_m;
    Matrix5 information = Matrix5::Zero();
    Vector5 gradient = Vector5::Zero();
    for (const int i : chosen) {
      const Eigen::Vector3d from = points[i].point - cylinder.point;
      const double along = cylinder.axis.dot(from);
      const Eigen::Vector3d radial = from - cylinder.axis * along;
      const double length = radial.norm();
      if (!(length > 0.0)) continue;
      const Eigen::Vector3d out = radial / length;
      Vector5 row;
      row << -out.dot(e0), -out.dot(e1), -1.0, -along * out.dot(e0), -along * out.dot(e1);
      information += row * row.transpose();
      gradient += row * (length - cylinder.radius_m);
      const Eigen::Vector3d& n = points[i].normal;
      Vector5 tilt;
      tilt << 0.0, 0.0, 0.0, lever * n.dot(e0), lever * n.dot(e1);
      information += tilt * tilt.transpose();
      gradient += tilt * (lever * n.dot(cylinder.axis));
    }
    const Vector5 step = information.ldlt().solve(gradient);
    if (!step.allFinite() || std::abs(step[2]) > 0.5 * cylinder.radius_m) return;
    cylinder.point -= step[0] * e0 + step[1] * e1;
    cylinder.radius_m -= step[2];
    cylinder.axis = (cylinder.axis - step[3] * e0 - step[4] * e1).normalized();
  }
}

/// Angle of the smallest arc that holds the normals, radians.
double arc_of(const std::vector<OrientedPoint>& points, const std::vector<int>& chosen,
              const Eigen::Vector3d& axis) {
  constexpr double kTurn = 6.283185307179586;
  const Eigen::Vector3d e0 = axis.unitOrthogonal(), e1 = axis.cross(e0);
  std::vector<double> angles;
  for (const int i : chosen)
    angles.push_back(det::atan2(points[i].normal.dot(e1), points[i].normal.dot(e0)));
  std::sort(angles.begin(), angles.end());
  double gap = kTurn - angles.back() + angles.front();
  for (std::size_t i = 1; i < angles.size(); ++i) gap = std::max(gap, angles[i] - angles[i - 1]);
  return kTurn - gap;
}

}  // namespace

double Cylinder::height_m(const Eigen::Vector3d& x) const {
  const Eigen::Vector3d from = x - point;
  return (from - axis * axis.dot(from)).norm() - radius_m;
}

double refine_cylinder(const std::vector<Eigen::Vector3d>& points, Cylinder& cylinder) {
  std::vector<OrientedPoint> without_normals;
  std::vector<int> all;
  for (const Eigen::Vector3d& point : points) {
    all.push_back(static_cast<int>(all.size()));
    without_normals.push_back({point, Eigen::Vector3d::Zero(), 0.0});
  }
  refine(without_normals, all, 4, cylinder);
  double squares = 0.0;
  for (const Eigen::Vector3d& point : points) {
    const double h = cylinder.height_m(point);
    squares += h * h;
  }
  return std::sqrt(squares / std::max(1.0, static_cast<double>(points.size())));
}

std::optional<CylinderFit> fit_cylinder(const std::vector<OrientedPoint>& points, int min_inliers,
                                        double max_radius_m, double max_angle_deg,
                                        double min_arc_deg, std::uint64_t seed) {
  if (static_cast<int>(points.size()) < min_inliers) return std::nullopt;
  const double min_cos = cos_degrees(max_angle_deg);
  Random random(seed);
  CylinderFit best;
  for (int k = 0; k < kHypotheses; ++k) {
    const std::vector<int> pair = {static_cast<int>(random.below(points.size())),
                                   static_cast<int>(random.below(points.size()))};
    const Eigen::Vector3d cross = points[pair[0]].normal.cross(points[pair[1]].normal);
    const double sine = cross.norm();
    if (!(sine > 0.17)) continue;  // 10 degrees: else noise turns the axis
    const auto cylinder = through(points, pair, cross / sine);
    if (!cylinder || !(cylinder->radius_m <= max_radius_m)) continue;
    auto inliers = inliers_of(points, *cylinder, min_cos);
    if (inliers.size() > best.inliers.size()) best = {*cylinder, std::move(inliers), 0.0};
  }
  for (int round = 0; round < 3; ++round) {
    if (static_cast<int>(best.inliers.size()) < min_inliers) return std::nullopt;
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const int i : best.inliers) scatter += points[i].normal * points[i].normal.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
    auto cylinder = through(points, best.inliers, solver.eigenvectors().col(0));
    if (!cylinder) return std::nullopt;
    refine(points, best.inliers, 8, *cylinder);
    if (!(cylinder->radius_m > 0.0 && cylinder->radius_m <= max_radius_m)) return std::nullopt;
    best.cylinder = *cylinder;
    best.inliers = inliers_of(points, *cylinder, min_cos);
  }
  if (static_cast<int>(best.inliers.size()) < min_inliers) return std::nullopt;
  if (arc_of(points, best.inliers, best.cylinder.axis) < min_arc_deg * kRadiansPerDegree)
    return std::nullopt;
  double squares = 0.0;
  for (const int i : best.inliers) {
    const double h = best.cylinder.height_m(points[i].point);
    squares += h * h;
  }
  best.rms_m = std::sqrt(squares / static_cast<double>(best.inliers.size()));
  return best;
}

}  // namespace weft::plane
