#pragma once

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <opencv2/core.hpp>

#include "rgbd/normals.hpp"

/// The normals' definition, pixel by pixel: the oracle of their tests.
namespace weft::test {

struct PlainNormal {
  bool defined = false;
  bool tie = false;  // a rule of definedness is met or broken by less than rounding
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
};

inline PlainNormal plain_normal(const rgbd::Surface& surface, const rgbd::NormalOptions& options,
                                int x, int y) {
  const auto depth_m = [&](int u, int v) {
    const float z = surface.points_m.at<cv::Vec3f>(v, u)[2];
    return z >= 0.01F && z <= 1000.0F ? z : 0.0F;
  };
  PlainNormal result;
  if (depth_m(x, y) == 0.0F) return result;
  const auto& camera = surface.camera;
  const double f = std::min(camera.fx, camera.fy);
  const float centre = 1.0F / depth_m(x, y);
  const double tangent =
      std::clamp(options.radius_m * centre, 2.01 / f, (options.max_radius_px + 0.01) / f);
  // What is inside the gate is decided as computed there, in single precision.
  const float gate = static_cast<float>(options.depth_gate_m) * centre * centre +
                     static_cast<float>(options.depth_noise_per_m);
  std::vector<Eigen::Vector3d> points;  // u, v, inverse depth
  for (int v = std::max(0, y - 16); v < std::min(surface.points_m.rows, y + 17); ++v) {
    for (int u = std::max(0, x - 16); u < std::min(surface.points_m.cols, x + 17); ++u) {
      const double at = std::hypot((u - x) / camera.fx, (v - y) / camera.fy);
      if (at > tangent || depth_m(u, v) == 0.0F) continue;
      const float inverse = 1.0F / depth_m(u, v);
      if (std::abs(inverse - centre) <= gate) points.emplace_back(u - x, v - y, inverse);
    }
  }
  const double n = static_cast<double>(points.size());
  const double wanted = options.min_share * M_PI * tangent * tangent * camera.fx * camera.fy;
  Eigen::MatrixXd matrix(points.size(), 3);
  Eigen::VectorXd values(points.size());
  Eigen::Vector2d mean(0, 0);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    matrix.row(row) << points[i].x(), points[i].y(), 1.0;
    values[row] = points[i].z();
    mean += points[i].head<2>() / n;
  }
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (const auto& p : points)
    covariance += (p.head<2>() - mean) * (p.head<2>() - mean).transpose() / n;
  const double spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance).eigenvalues()[0];
  result.tie = std::abs(spread - 0.4) < 1e-4 || std::abs(n - wanted) < 1e-3;
  if (n < 6 || n < wanted || spread < 0.4) return result;
  const Eigen::Vector3d plane = matrix.colPivHouseholderQr().solve(values);
  // Points (u - cx) z / fx, ... satisfy normal . p = -1 for inverse depth a u + b v + c.
  result.normal =
      -Eigen::Vector3d(plane[0] * camera.fx, plane[1] * camera.fy,
                       plane[2] + plane[0] * (camera.cx - x) + plane[1] * (camera.cy - y))
           .normalized();
  result.defined = plane[2] > 0.0;
  return result;
}

/// Expects the normals to be those of the definition in part of the surface; returns how many are.
inline int expect_plain_normals(const cv::Mat& normals, const rgbd::Surface& surface,
                                const rgbd::NormalOptions& options, cv::Rect part, int step) {
  int defined = 0;
  for (int y = part.y; y < part.y + part.height; y += step) {
    for (int x = part.x; x < part.x + part.width; x += step) {
      const auto expected = plain_normal(surface, options, x, y);
      if (expected.tie) continue;
      const auto& n = normals.at<cv::Vec3f>(y, x);
      EXPECT_EQ(expected.defined, !std::isnan(n[0]) && !std::isnan(n[1]) && !std::isnan(n[2]))
          << x << ", " << y;
      if (!expected.defined) continue;
      ++defined;
      EXPECT_LT((expected.normal - Eigen::Vector3d(n[0], n[1], n[2])).norm(), 2e-4)
          << x << ", " << y << ": " << n << " expected " << expected.normal.transpose();
    }
  }
  return defined;
}

}  // namespace weft::test
