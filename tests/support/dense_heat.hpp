#pragma once

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <complex>
#include <opencv2/core.hpp>
#include <vector>

#include "descriptor/hks_options.hpp"
#include "rgbd/surface.hpp"

/// The scale-invariant heat kernel signature by a dense eigendecomposition, for tests and
/// benchmarks: slow, obvious, libm.
namespace weft::test {

/// Empty when the point is in no triangle. patch: in points of the surface.
inline std::vector<double> dense_hks(const rgbd::Surface& surface, cv::Rect patch, cv::Point centre,
                                     const descriptor::HksOptions& options) {
  const auto count = static_cast<Eigen::Index>(patch.area());
  Eigen::MatrixXd laplacian = Eigen::MatrixXd::Zero(count, count);
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(count);
  const auto point_mm = [&](int x, int y) {
    const auto p = surface.points_m.at<cv::Vec3f>(y, x);
    return Eigen::Vector3d(1000.0 * p[0], 1000.0 * p[1], 1000.0 * p[2]);
  };
  const auto add_triangle = [&](std::array<cv::Point, 3> corners) {
    std::array<Eigen::Vector3d, 3> p;
    double near = 1e300, far = -1e300;
    for (std::size_t i = 0; i < 3; ++i) {
      p[i] = point_mm(corners[i].x, corners[i].y);
      if (!p[i].allFinite()) return;
      near = std::min(near, p[i].z());
      far = std::max(far, p[i].z());
    }
    if (far - near > rgbd::kDepthJump * near) return;
    const double area = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).norm();
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
      const Eigen::Vector3d to_j = p[j] - p[i], to_k = p[k] - p[i];
      const double angle = std::atan2(to_j.cross(to_k).norm(), to_j.dot(to_k));
      const double weight = 0.5 / std::tan(angle);
      const auto number = [&](cv::Point c) {
        return Eigen::Index{(c.y - patch.y) * patch.width + c.x - patch.x};
      };
      const Eigen::Index a = number(corners[j]), b = number(corners[k]);
      laplacian(a, a) += weight;
      laplacian(b, b) += weight;
      laplacian(a, b) -= weight;
      laplacian(b, a) -= weight;
      mass[number(corners[i])] += area / 3.0;
    }
  };
  for (int y = patch.y; y + 1 < patch.y + patch.height; ++y) {
    for (int x = patch.x; x + 1 < patch.x + patch.width; ++x) {
      add_triangle({cv::Point(x, y), cv::Point(x + 1, y), cv::Point(x, y + 1)});
      add_triangle({cv::Point(x + 1, y + 1), cv::Point(x, y + 1), cv::Point(x + 1, y)});
    }
  }
  const auto at_centre = Eigen::Index{(centre.y - patch.y) * patch.width + centre.x - patch.x};
  if (!(mass[at_centre] > 0.0)) return {};
  // Points without triangles stay by themselves.
  const Eigen::VectorXd root =
      mass.unaryExpr([](double m) { return m > 0.0 ? 1.0 / std::sqrt(m) : 0.0; });
  laplacian = root.asDiagonal() * laplacian * root.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(laplacian);
  std::vector<double> signal;
  for (int sample = 0; sample < options.samples(); ++sample) {
    const double t =
        options.t_min_mm2 * std::exp2(sample / static_cast<double>(options.samples_per_octave));
    double heat = 0.0, change = 0.0;
    for (Eigen::Index i = 0; i < count; ++i) {
      const double value = std::max(0.0, solver.eigenvalues()[i]);
      const double left = std::exp(-value * t) * std::pow(solver.eigenvectors()(at_centre, i), 2);
      heat += left;
      change -= t * value * left;
    }
    signal.push_back(std::log(2.0) * change / heat);
  }
  std::vector<double> magnitudes;
  for (int f = 0; f < options.frequencies; ++f) {
    std::complex<double> sum = 0.0;
    for (std::size_t i = 0; i < signal.size(); ++i) {
      sum += signal[i] * std::polar(1.0, -2.0 * M_PI * f * static_cast<double>(i) /
                                             static_cast<double>(signal.size()));
    }
    magnitudes.push_back(std::abs(sum));
  }
  return magnitudes;
}

}  // namespace weft::test
