#pragma once

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>
#include <vector>

#include "base/random.hpp"
#include "plane/extractor.hpp"
#include "slam/bundle_adjustment.hpp"
#include "slam/pose_optimiser.hpp"

/// A room with known cameras, points and planes, and observations with known Gaussian noise.
namespace weft::slam::test {

/// Gaussian to the tails, unlike Random::normal: chi-squared tests look at those.
inline double gauss(Random& random) {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - random.uniform()));
  return radius * std::cos(2.0 * std::numbers::pi * random.uniform());
}
inline Eigen::Vector3d gauss3(Random& random) {
  const double x = gauss(random), y = gauss(random), z = gauss(random);
  return {x, y, z};
}
inline Vector6d gauss6(Random& random, double sigma_rad, double sigma_m) {
  Vector6d v;
  v << sigma_rad * gauss3(random), sigma_m * gauss3(random);
  return v;
}
inline Eigen::Vector3d unit3(Random& random) { return gauss3(random).normalized(); }
inline Rigid3d any_pose(Random& random) {
  return {exp_rotation(random.uniform(0.0, 3.0) * unit3(random)), 2.0 * gauss3(random)};
}

inline CameraModel kinect() { return {640, 480, 525.0, 525.0, 319.5, 239.5}; }

struct WorldOptions {
  int cameras = 8;
  int points = 200;
  int planes = 4;
  int seed = 1;
  double sigma_px = 0.7;
  double sigma_tilt_rad = 0.01;
  double sigma_distance_m = 0.02;
  double depth_share = 0.8;  // of the point observations with depth
};

struct World {
  BundleProblem truth;  // with noisy observations
  CameraModel camera = kinect();
};

/// Cameras on an arc looking at the middle of a box of 4 x 3 x 4 m; the first is fixed.
inline World make_world(const WorldOptions& o) {
  Random random(static_cast<std::uint64_t>(o.seed));
  World w;
  for (int c = 0; c < o.cameras; ++c) {
    const double turn = 0.8 * (o.cameras > 1 ? c / double(o.cameras - 1) - 0.5 : 0.0);
    const Eigen::Vector3d position(2.5 * std::sin(turn), 0.1 * gauss(random),
                                   -2.5 * std::cos(turn));
    const Rigid3d T_world_camera{
        exp_rotation({0.05 * gauss(random), -turn + 0.05 * gauss(random), 0.05 * gauss(random)}),
        position};
    w.truth.cameras.push_back({T_world_camera.inverse(), c == 0});
  }
  const Eigen::Vector3d normals[] = {{0, -1, 0}, {0, 0, -1}, {1, 0, -0.2}, {-1, 0.1, -0.3}};
  for (int k = 0; k < o.planes; ++k) {
    w.truth.planes.push_back({normals[k % 4].normalized(), -1.5 - 0.2 * (k / 4), false});
  }
  for (int p = 0; p < o.points; ++p) {
    w.truth.points.push_back(
        {{random.uniform(-1.2, 1.2), random.uniform(-0.9, 0.9), random.uniform(-1.0, 1.5)}, false});
  }
  for (int c = 0; c < o.cameras; ++c) {
    const Rigid3d& T = w.truth.cameras[static_cast<std::size_t>(c)].T_camera_world;
    for (int p = 0; p < o.points; ++p) {
      const Eigen::Vector3d x = T * w.truth.points[static_cast<std::size_t>(p)].position_world;
      PointObservation seen;
      seen.camera = c;
      seen.point = p;
      seen.sigma_px = o.sigma_px * (p % 3 == 0 ? 2.0 : 1.0);
      seen.pixel = w.camera.project(x);
      if (x.z() < 0.3 || seen.pixel.x() < 0 || seen.pixel.y() < 0 || seen.pixel.x() > 639 ||
          seen.pixel.y() > 479) {
        continue;
      }
      const double du = gauss(random), dv = gauss(random);
      seen.pixel += seen.sigma_px * Eigen::Vector2d(du, dv);
      if (random.uniform() < o.depth_share) {
        seen.sigma_depth_m = 0.003 * x.z() * x.z();
        seen.depth_m = x.z() + seen.sigma_depth_m * gauss(random);
      }
      w.truth.point_observations.push_back(seen);
    }
    for (int k = 0; k < o.planes; ++k) {
      const PlaneState& plane = w.truth.planes[static_cast<std::size_t>(k)];
      PlaneObservation seen;
      seen.camera = c;
      seen.plane = k;
      // Correlated: the distance varies with the tilt through a lever.
      const Eigen::Vector2d lever(0.5, -0.8);
      const Eigen::Matrix2d tilt = Eigen::Vector2d(1.0, 0.5).cwiseAbs2().asDiagonal() *
                                   Eigen::Matrix2d::Identity() * o.sigma_tilt_rad *
                                   o.sigma_tilt_rad;
      seen.covariance.topLeftCorner<2, 2>() = tilt;
      seen.covariance.block<2, 1>(0, 2) = tilt * lever;
      seen.covariance.block<1, 2>(2, 0) = (tilt * lever).transpose();
      seen.covariance(2, 2) = o.sigma_distance_m * o.sigma_distance_m + lever.dot(tilt * lever);
      const Eigen::Matrix3d root = seen.covariance.llt().matrixL();
      const Eigen::Vector3d noise = root * gauss3(random);
      const Eigen::Vector3d n = T.rotation * plane.normal_world;
      const double d = plane.distance_m + n.dot(T.translation);
      // The observed plane is the one from which the true one lies by minus the noise; the basis
      // is the observed one's, the same to first order.
      const auto [e0, e1] = plane::tangent_basis(n);
      seen.normal_camera = (n + noise[0] * e0 + noise[1] * e1).normalized();
      seen.distance_m = d + noise[2];
      if (k % 2 == 1) {  // which way it points must not matter
        const auto [f0, f1] = plane::tangent_basis(seen.normal_camera);
        const auto [g0, g1] = plane::tangent_basis(-seen.normal_camera);
        Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
        turn.topLeftCorner<2, 2>() << g0.dot(-f0), g0.dot(-f1), g1.dot(-f0), g1.dot(-f1);
        turn(2, 2) = -1.0;
        seen.normal_camera = -seen.normal_camera;
        seen.distance_m = -seen.distance_m;
        seen.covariance = turn * seen.covariance * turn.transpose();
      }
      w.truth.plane_observations.push_back(seen);
    }
  }
  return w;
}

/// No floors: the noise is the one stated.
inline PlaneNoise no_floors() { return {0.0, 0.0}; }

/// 99.99 % bounds of chi-squared with many degrees of freedom (Wilson and Hilferty).
inline bool is_plausible_chi_squared(double chi_squared, int degrees_of_freedom) {
  const double n = degrees_of_freedom;
  const double z =
      (std::cbrt(chi_squared / n) - (1.0 - 2.0 / (9.0 * n))) / std::sqrt(2.0 / (9.0 * n));
  return std::abs(z) < 3.9;
}

}  // namespace weft::slam::test
