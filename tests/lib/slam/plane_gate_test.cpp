#include "slam/plane_gate.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "slam/chi_squared.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

constexpr int kDraws = 20000;

/// A plane in the camera's frame moved by (tilt, tilt, distance) in its tangent basis.
rgbd::Plane moved(rgbd::Plane plane, const Eigen::Vector3d& by) {
  const auto [e0, e1] = plane::tangent_basis(plane.normal);
  plane.normal = (plane.normal + by[0] * e0 + by[1] * e1).normalized();
  plane.distance_m += by[2];
  return plane;
}

struct Case {
  Rigid3d T{exp_rotation({0.3, -0.7, 0.4}), {0.5, -0.3, 1.2}};
  rgbd::Plane plane;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  Matrix6d pose_covariance = Matrix6d::Zero();
  Case() {
    plane.normal = Eigen::Vector3d(0.2, -0.5, -0.8).normalized();
    plane.distance_m = -1.7;
    const Eigen::Matrix3d root{{0.006, 0, 0}, {0.002, 0.004, 0}, {0.005, -0.004, 0.01}};
    covariance = root * root.transpose();
    Random random(1);
    Matrix6d pose_root;
    for (double& value : pose_root.reshaped()) value = 0.002 * test::gauss(random);
    pose_covariance = pose_root * pose_root.transpose();
  }
};

TEST(PlaneGate, PlanesGoThereAndBack) {
  const Case c;
  const auto back = in_camera(in_world(c.plane, c.T), c.T);
  EXPECT_LT((back.normal - c.plane.normal).norm(), 1e-12);
  EXPECT_NEAR(back.distance_m, c.plane.distance_m, 1e-12);
  // The landmark's own sign does not matter.
  PlaneState flipped = in_world(c.plane, c.T);
  flipped.normal_world = -flipped.normal_world;
  flipped.distance_m = -flipped.distance_m;
  EXPECT_LT((in_camera(flipped, c.T).normal - c.plane.normal).norm(), 1e-12);
  // A point on the one is on the other.
  const Eigen::Vector3d on =
      c.plane.normal * c.plane.distance_m + 0.3 * plane::tangent_basis(c.plane.normal).first;
  const PlaneState world = in_world(c.plane, c.T);
  EXPECT_NEAR(world.normal_world.dot(c.T.inverse() * on), world.distance_m, 1e-12);
}

TEST(PlaneGate, CovarianceInTheWorldIsThatOfDrawnPlanes) {
  const Case c;
  const Eigen::Matrix3d root = c.covariance.llt().matrixL();
  const Matrix6d pose_root = c.pose_covariance.llt().matrixL();
  const PlaneState mean = in_world(c.plane, c.T);
  const auto [e0, e1] = plane::tangent_basis(mean.normal_world);
  Random random(2);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (int i = 0; i < kDraws; ++i) {
    const Eigen::Vector3d by = root * test::gauss3(random);
    const Vector6d step = pose_root * test::gauss6(random, 1.0, 1.0);
    const PlaneState drawn = in_world(moved(c.plane, by), plus(c.T, step));
    const Eigen::Vector3d e(e0.dot(drawn.normal_world), e1.dot(drawn.normal_world),
                            drawn.distance_m - mean.distance_m);
    sum += e * e.transpose() / kDraws;
  }
  const auto covariance = covariance_in_world(c.plane, c.covariance, c.T, c.pose_covariance);
  EXPECT_LT((sum - covariance).norm(), 0.04 * covariance.norm());
}

TEST(PlaneGate, TheDistanceOfEqualPlanesIsChiSquared) {
  // Observation, landmark and pose all drawn about the truth.
  const Case c;
  const PlaneState truth = in_world(c.plane, c.T);
  const Eigen::Matrix3d root = c.covariance.llt().matrixL();
  const Matrix6d pose_root = c.pose_covariance.llt().matrixL();
  const auto [e0, e1] = plane::tangent_basis(truth.normal_world);
  const Eigen::Matrix3d map_root = Eigen::Vector3d(0.004, 0.007, 0.012).asDiagonal();
  Random random(3);
  double sum = 0.0;
  int inside = 0;
  for (int i = 0; i < kDraws; ++i) {
    const rgbd::Plane seen = moved(c.plane, root * test::gauss3(random));
    const Eigen::Vector3d by = map_root * test::gauss3(random);
    PlaneState landmark{(truth.normal_world + by[0] * e0 + by[1] * e1).normalized(),
                        truth.distance_m + by[2], false};
    if (i % 2) {  // which way the landmark points does not matter, nor does its basis' turn
      landmark.normal_world = -landmark.normal_world;
      landmark.distance_m = -landmark.distance_m;
    }
    Eigen::Matrix3d map_covariance = map_root * map_root.transpose();
    const auto [f0, f1] = plane::tangent_basis(landmark.normal_world);
    Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
    const double sign = i % 2 ? -1.0 : 1.0;
    turn.topLeftCorner<2, 2>() << f0.dot(e0), f0.dot(e1), f1.dot(e0), f1.dot(e1);
    turn.topLeftCorner<2, 2>() *= sign;
    turn(2, 2) = sign;
    map_covariance = (turn * map_covariance * turn.transpose()).eval();
    PlaneObservation observation;
    observation.normal_camera = seen.normal;
    observation.distance_m = seen.distance_m;
    observation.covariance = c.covariance;
    const Vector6d step = pose_root * test::gauss6(random, 1.0, 1.0);
    const double d = plane_distance(landmark, map_covariance, observation, plus(c.T, step),
                                    c.pose_covariance, test::no_floors());
    sum += d;
    inside += d <= chi_squared_95(3);
  }
  EXPECT_NEAR(sum / kDraws, 3.0, 0.08);
  EXPECT_NEAR(inside / double(kDraws), 0.95, 0.006);
}

TEST(PlaneGate, AFoldedGarmentIsNotTheTable) {
  // Three centimetres above the table, 5 degrees off it: 30 degrees and 0.1 m would take it.
  const PlaneState table{{0, -1, 0}, -0.8, false};
  const Eigen::Matrix3d known = Eigen::Vector3d(1e-5, 1e-5, 1e-5).asDiagonal();
  PlaneObservation seen;
  seen.normal_camera = {0, -1, 0};
  seen.distance_m = -0.8;
  EXPECT_LT(plane_distance(table, known, seen, {}, Matrix6d::Zero()), 1e-9);
  seen.distance_m = -0.77;
  EXPECT_GT(plane_distance(table, known, seen, {}, Matrix6d::Zero()), chi_squared_95(3));
  seen.distance_m = -0.8;
  seen.normal_camera = exp_rotation({0.087, 0, 0}) * seen.normal_camera;
  EXPECT_GT(plane_distance(table, known, seen, {}, Matrix6d::Zero()), chi_squared_95(3));
}

TEST(PlaneGate, WhatCannotBeIsRefused) {
  const PlaneState table{{0, -1, 0}, -0.8, false};
  PlaneObservation seen;
  EXPECT_THROW(plane_distance({{0, -2, 0}, 1.0, false}, {}, seen, {}, {}), Error);
  seen.distance_m = std::nan("");
  EXPECT_THROW(plane_distance(table, Eigen::Matrix3d::Zero(), seen, {}, Matrix6d::Zero()), Error);
}

}  // namespace
}  // namespace weft::slam
