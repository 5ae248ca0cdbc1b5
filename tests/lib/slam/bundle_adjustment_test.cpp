#include "slam/bundle_adjustment.hpp"

#include <ceres/covariance.h>
#include <ceres/problem.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cstring>
#include <limits>

#include "base/error.hpp"
#include "slam/ceres_costs.hpp"
#include "slam/chi_squared.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

using test::WorldOptions;

BundleOptions plain() {
  BundleOptions options;
  options.plane_noise = test::no_floors();
  options.first_iterations = options.iterations = 50;
  return options;
}

/// Everything free moved off the truth.
BundleProblem perturbed(BundleProblem problem, double sigma, int seed) {
  Random random(static_cast<std::uint64_t>(seed));
  for (auto& camera : problem.cameras) {
    if (!camera.fixed) {
      camera.T_camera_world = plus(camera.T_camera_world, test::gauss6(random, sigma, sigma));
    }
  }
  for (auto& point : problem.points) point.position_world += sigma * test::gauss3(random);
  for (auto& plane : problem.planes) {
    plane.normal_world = (plane.normal_world + sigma * test::gauss3(random)).normalized();
    plane.distance_m += sigma * test::gauss(random);
  }
  return problem;
}

double worst_camera(const BundleProblem& a, const BundleProblem& b) {
  double worst = 0.0;
  for (std::size_t i = 0; i < a.cameras.size(); ++i) {
    worst = std::max(worst, minus(a.cameras[i].T_camera_world, b.cameras[i].T_camera_world).norm());
  }
  return worst;
}

template <class Cost, class First, class Second, class FirstManifold, class SecondManifold>
void check_jacobians(const Cost& cost, First first, Second second,
                     const FirstManifold& first_manifold, const SecondManifold& second_manifold) {
  // Along the manifolds: where Ceres steps.
  const int rows = cost.num_residuals();
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> J0(rows, first.size()),
      J1(rows, second.size());
  const double* blocks[] = {first.data(), second.data()};
  double* jacobians[] = {J0.data(), J1.data()};
  Eigen::VectorXd e(rows);
  ASSERT_TRUE(cost.Evaluate(blocks, e.data(), jacobians));
  const auto along = [&](const ceres::Manifold& manifold, auto block, int which, const auto& J) {
    const int size = manifold.TangentSize();
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> onto(
        manifold.AmbientSize(), size);
    manifold.PlusJacobian(block.data(), onto.data());
    const Eigen::MatrixXd analytic = J * onto;
    for (int k = 0; k < size; ++k) {
      Eigen::VectorXd step = Eigen::VectorXd::Zero(size), forward(rows), back(rows);
      auto moved = block;
      const auto evaluate = [&](Eigen::VectorXd& out) {
        const double* at[] = {which == 0 ? moved.data() : first.data(),
                              which == 1 ? moved.data() : second.data()};
        cost.Evaluate(at, out.data(), nullptr);
      };
      step[k] = 1e-6;
      manifold.Plus(block.data(), step.data(), moved.data());
      evaluate(forward);
      step[k] = -1e-6;
      manifold.Plus(block.data(), step.data(), moved.data());
      evaluate(back);
      const Eigen::VectorXd numeric = (forward - back) / 2e-6;
      EXPECT_LT((numeric - analytic.col(k)).norm(), 1e-5 * (1.0 + numeric.norm()));
    }
  };
  along(first_manifold, first, 0, J0);
  along(second_manifold, second, 1, J1);
}

TEST(CeresCosts, DerivativesAlongTheManifoldsAreTheNumericOnes) {
  const auto world = test::make_world({});
  Random random(1);
  const PoseManifold pose_manifold;
  const PlaneManifold plane_manifold;
  const ceres::EuclideanManifold<3> point_manifold;
  for (int i = 0; i < 20; ++i) {
    const auto& seen = world.truth.point_observations[random.below(500)];
    const Rigid3d T =
        plus(world.truth.cameras[static_cast<std::size_t>(seen.camera)].T_camera_world,
             test::gauss6(random, 0.1, 0.1));
    const auto& X = world.truth.points[static_cast<std::size_t>(seen.point)].position_world;
    const std::array<double, 3> point{X.x(), X.y(), X.z()};
    check_jacobians(PointCost<2>(world.camera, seen), to_block(T), point, pose_manifold,
                    point_manifold);
    check_jacobians(PointCost<3>(world.camera, seen), to_block(T), point, pose_manifold,
                    point_manifold);
    const PlaneFactor factor(world.truth.plane_observations[random.below(30)], test::no_floors(),
                             "here");
    const Eigen::Vector3d n = test::unit3(random);
    const Rigid3d A = test::any_pose(random), B = test::any_pose(random);
    check_jacobians(PlaneCost(factor), to_block(A), PlaneBlock{n.x(), n.y(), n.z(), 0.7},
                    pose_manifold, plane_manifold);
    const Rigid3d off = plus({}, test::gauss6(random, 0.5, 0.5));
    Matrix6d weight;
    for (double& value : weight.reshaped()) value = test::gauss(random);
    check_jacobians(PairCost(object_residual, A * B * off, weight), to_block(A), to_block(B),
                    pose_manifold, pose_manifold);
    check_jacobians(PairCost(relative_residual, A * B.inverse() * off, weight), to_block(A),
                    to_block(B), pose_manifold, pose_manifold);
  }
}

TEST(BundleAdjustment, KnownNoiseGivesTheExpectedChiSquared) {
  double sum = 0.0;
  int freedom = 0;
  for (int seed = 1; seed <= 4; ++seed) {
    auto world = test::make_world({.cameras = 6, .points = 80, .seed = seed});
    auto options = plain();
    options.reject = false;
    auto problem = perturbed(world.truth, 0.02, seed);
    const auto result = optimise(problem, world.camera, options);
    EXPECT_TRUE(result.converged);
    // 99.99 % bounds; the kernel pulls a little less at the 5 % beyond it.
    EXPECT_TRUE(test::is_plausible_chi_squared(result.chi_squared, result.degrees_of_freedom))
        << result.chi_squared << " of " << result.degrees_of_freedom;
    sum += result.chi_squared;
    freedom += result.degrees_of_freedom;
  }
  EXPECT_TRUE(test::is_plausible_chi_squared(sum, freedom)) << sum << " of " << freedom;
}

TEST(BundleAdjustment, RecoversFromPerturbedStarts) {
  for (int seed = 1; seed <= 3; ++seed) {
    const auto world = test::make_world({.cameras = 6, .points = 80, .seed = seed});
    BundleProblem best = world.truth;
    optimise(best, world.camera, plain());
    EXPECT_LT(worst_camera(best, world.truth), 0.02);
    for (const double sigma : {0.01, 0.05, 0.1}) {
      BundleProblem moved = perturbed(world.truth, sigma, seed);
      optimise(moved, world.camera, plain());
      EXPECT_LT(worst_camera(moved, best), 2e-3) << sigma;
    }
  }
}

TEST(BundleAdjustment, ErrorsAreAsLargeAsTheCovariancesSay) {
  double cameras = 0.0, planes = 0.0, points = 0.0;
  int camera_freedom = 0, plane_freedom = 0, point_freedom = 0;
  for (int seed = 1; seed <= 25; ++seed) {
    const auto world =
        test::make_world({.cameras = 3, .points = 30, .seed = seed, .sigma_tilt_rad = 0.004});
    auto options = plain();
    options.reject = false;
    options.pose_covariances = options.plane_covariances = options.point_covariances = true;
    BundleProblem problem = world.truth;
    const auto result = optimise(problem, world.camera, options);
    const auto squared = [](const auto& error, const auto& covariance) {
      return error.dot(covariance.llt().solve(error));
    };
    EXPECT_EQ(result.pose_covariances[0], Matrix6d(Matrix6d::Zero()));
    // One of each: what is estimated together is correlated.
    cameras +=
        squared(minus(problem.cameras[2].T_camera_world, world.truth.cameras[2].T_camera_world),
                result.pose_covariances[2]);
    camera_freedom += 6;
    const auto& plane = problem.planes[1];
    const auto [e0, e1] = plane::tangent_basis(plane.normal_world);
    const auto& true_plane = world.truth.planes[1];
    planes +=
        squared(Eigen::Vector3d(e0.dot(true_plane.normal_world), e1.dot(true_plane.normal_world),
                                true_plane.distance_m - plane.distance_m),
                result.plane_covariances[1]);
    plane_freedom += 3;
    points += squared(
        Eigen::Vector3d(problem.points[7].position_world - world.truth.points[7].position_world),
        result.point_covariances[7]);
    point_freedom += 3;
  }
  // Huber's kernel costs a few per cent of efficiency.
  EXPECT_TRUE(test::is_plausible_chi_squared(cameras, camera_freedom))
      << cameras << " of " << camera_freedom;
  EXPECT_TRUE(test::is_plausible_chi_squared(planes, plane_freedom))
      << planes << " of " << plane_freedom;
  EXPECT_TRUE(test::is_plausible_chi_squared(points, point_freedom))
      << points << " of " << point_freedom;
}

TEST(BundleAdjustment, CovariancesAreThoseOfCeres) {
  const auto world = test::make_world({.cameras = 3, .points = 25});
  auto options = plain();
  options.pose_covariances = options.plane_covariances = options.point_covariances = true;
  BundleProblem problem = world.truth;
  const auto result = optimise(problem, world.camera, options);

  PoseManifold pose_manifold;
  PlaneManifold plane_manifold;
  ceres::Problem::Options ownership;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem peer(ownership);
  std::vector<PoseBlock> cameras;
  std::vector<PlaneBlock> planes;
  std::vector<PlaneFactor> factors;
  for (const auto& camera : problem.cameras) cameras.push_back(to_block(camera.T_camera_world));
  for (const auto& plane : problem.planes) {
    const auto& n = plane.normal_world;
    planes.push_back({n.x(), n.y(), n.z(), plane.distance_m});
  }
  for (const auto& seen : problem.plane_observations) {
    factors.emplace_back(seen, options.plane_noise, "here");
  }
  const auto at = [](auto& list, int i) { return list[static_cast<std::size_t>(i)].data(); };
  for (std::size_t i = 0; i < problem.point_observations.size(); ++i) {
    const auto& seen = problem.point_observations[i];
    if (!result.point_inlier[i]) continue;
    ceres::CostFunction* cost;
    if (seen.dimension() == 3) {
      cost = new PointCost<3>(world.camera, seen);
    } else {
      cost = new PointCost<2>(world.camera, seen);
    }
    peer.AddResidualBlock(
        cost, nullptr, at(cameras, seen.camera),
        problem.points[static_cast<std::size_t>(seen.point)].position_world.data());
  }
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (!result.plane_inlier[i]) continue;
    const auto& seen = problem.plane_observations[i];
    peer.AddResidualBlock(new PlaneCost(factors[i]), nullptr, at(cameras, seen.camera),
                          at(planes, seen.plane));
  }
  for (auto& block : cameras) peer.SetManifold(block.data(), &pose_manifold);
  for (auto& block : planes) peer.SetManifold(block.data(), &plane_manifold);
  peer.SetParameterBlockConstant(cameras[0].data());
  ceres::Covariance::Options how;
  how.algorithm_type = ceres::DENSE_SVD;
  ceres::Covariance covariance(how);
  const double* point = problem.points[4].position_world.data();
  ASSERT_TRUE(covariance.Compute({{cameras[1].data(), cameras[1].data()},
                                  {planes[2].data(), planes[2].data()},
                                  {point, point}},
                                 &peer));
  Eigen::Matrix<double, 7, 7, Eigen::RowMajor> ambient_pose;
  covariance.GetCovarianceBlock(cameras[1].data(), cameras[1].data(), ambient_pose.data());
  const auto onto = increment_by_block(cameras[1].data());
  const Matrix6d pose = onto * ambient_pose * onto.transpose();
  EXPECT_LT((pose - result.pose_covariances[1]).norm(), 1e-6 * pose.norm());
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> ambient_plane;
  covariance.GetCovarianceBlock(planes[2].data(), planes[2].data(), ambient_plane.data());
  const auto [e0, e1] = plane::tangent_basis(problem.planes[2].normal_world);
  Eigen::Matrix<double, 3, 4> tangents = Eigen::Matrix<double, 3, 4>::Zero();
  tangents.block<1, 3>(0, 0) = e0.transpose();
  tangents.block<1, 3>(1, 0) = e1.transpose();
  tangents(2, 3) = 1.0;
  const Eigen::Matrix3d plane = tangents * ambient_plane * tangents.transpose();
  EXPECT_LT((plane - result.plane_covariances[2]).norm(), 1e-6 * plane.norm());
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> of_point;
  covariance.GetCovarianceBlock(point, point, of_point.data());
  EXPECT_LT((of_point - result.point_covariances[4]).norm(), 1e-6 * of_point.norm());
}

TEST(BundleAdjustment, RejectsFalseObservations) {
  auto world = test::make_world({.cameras = 6, .points = 100});
  Random random(3);
  auto& seen = world.truth.point_observations;
  std::size_t false_count = 0;
  for (std::size_t i = 5; i < seen.size(); i += 10, ++false_count) {
    seen[i].pixel = {random.uniform(0, 640), random.uniform(0, 480)};
  }
  world.truth.plane_observations[6].distance_m += 0.4;
  BundleProblem problem = perturbed(world.truth, 0.02, 3);
  const auto result = optimise(problem, world.camera, plain());
  EXPECT_LT(worst_camera(problem, world.truth), 0.02);
  std::size_t rejected_false = 0, rejected = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    rejected += !result.point_inlier[i];
    rejected_false += !result.point_inlier[i] && i % 10 == 5;
  }
  EXPECT_GE(rejected_false, false_count - 2);
  EXPECT_LT(rejected - rejected_false, seen.size() / 10);
  EXPECT_EQ(result.plane_inlier[6], 0);
}

TEST(BundleAdjustment, PlanesTieWherePointsDoNot) {
  // Two cameras without a common point: only planes and one relative pose hold the second.
  auto world = test::make_world(
      {.cameras = 2, .points = 40, .planes = 2, .sigma_tilt_rad = 1e-4, .sigma_distance_m = 1e-4});
  std::erase_if(world.truth.point_observations,
                [](const auto& seen) { return seen.camera != seen.point % 2; });
  const Rigid3d& A = world.truth.cameras[0].T_camera_world;
  const Rigid3d& B = world.truth.cameras[1].T_camera_world;
  world.truth.relative_poses.push_back({0, 1, A * B.inverse(), 100.0 * Matrix6d::Identity()});
  BundleProblem problem = perturbed(world.truth, 0.05, 4);
  const auto result = optimise(problem, world.camera, plain());
  EXPECT_LT(worst_camera(problem, world.truth), 0.01);
  EXPECT_EQ(result.plane_inlier, std::vector<std::uint8_t>(4, 1));
}

TEST(BundleAdjustment, ObjectsAreLandmarksToo) {
  auto world = test::make_world({.cameras = 4, .points = 40});
  Random random(5);
  const Rigid3d T_world_object = test::any_pose(random);
  world.truth.objects.push_back({T_world_object, false});
  const Vector6d sigma = (Vector6d() << 0.02, 0.02, 0.02, 0.01, 0.01, 0.01).finished();
  for (int c = 0; c < 4; ++c) {
    Vector6d noise = sigma.cwiseProduct(test::gauss6(random, 1.0, 1.0));
    if (c == 3) noise[5] += 1.0;  // one false
    const Rigid3d& T = world.truth.cameras[static_cast<std::size_t>(c)].T_camera_world;
    world.truth.object_observations.push_back(
        {c, 0, T * T_world_object * plus({}, noise),
         Matrix6d(sigma.cwiseAbs2().cwiseInverse().asDiagonal())});
  }
  BundleProblem problem = perturbed(world.truth, 0.02, 5);
  problem.objects[0].T_world_object = plus(T_world_object, test::gauss6(random, 0.2, 0.2));
  const auto result = optimise(problem, world.camera, plain());
  EXPECT_LT(minus(problem.objects[0].T_world_object, T_world_object).norm(), 0.06);
  EXPECT_EQ(result.object_inlier, (std::vector<std::uint8_t>{1, 1, 1, 0}));
}

TEST(BundleAdjustment, WhatIsFixedStays) {
  auto world = test::make_world({.cameras = 4, .points = 60});
  BundleProblem problem = perturbed(world.truth, 0.02, 6);
  problem.cameras[2].fixed = problem.points[3].fixed = problem.planes[1].fixed = true;
  const BundleProblem before = problem;
  optimise(problem, world.camera, plain());
  for (const std::size_t c : {0u, 2u}) {
    EXPECT_EQ(minus(problem.cameras[c].T_camera_world, before.cameras[c].T_camera_world).norm(), 0);
  }
  EXPECT_EQ(problem.points[3].position_world, before.points[3].position_world);
  EXPECT_EQ(problem.planes[1].normal_world, before.planes[1].normal_world);
  EXPECT_NE(problem.points[4].position_world, before.points[4].position_world);
  // All landmarks fixed: only the cameras move.
  for (auto& point : problem.points) point.fixed = true;
  EXPECT_NO_THROW(optimise(problem, world.camera, plain()));
  // Nothing at all to move.
  for (auto& camera : problem.cameras) camera.fixed = true;
  for (auto& plane : problem.planes) plane.fixed = true;
  EXPECT_NO_THROW(optimise(problem, world.camera, plain()));
}

TEST(BundleAdjustment, WhatNobodySeesStaysAndHasNoCovariance) {
  auto world = test::make_world({.cameras = 3, .points = 30});
  std::erase_if(world.truth.point_observations, [](const auto& seen) { return seen.point == 5; });
  // Point 6 in one view without depth: on a ray.
  int kept = 0;
  std::erase_if(world.truth.point_observations,
                [&](const auto& seen) { return seen.point == 6 && kept++ > 0; });
  for (auto& seen : world.truth.point_observations) {
    if (seen.point == 6) seen.depth_m = 0.0;
  }
  world.truth.planes.push_back({Eigen::Vector3d::UnitX(), 1.0, false});
  auto options = plain();
  options.pose_covariances = options.plane_covariances = options.point_covariances = true;
  BundleProblem problem = world.truth;
  const auto result = optimise(problem, world.camera, options);
  EXPECT_EQ(problem.points[5].position_world, world.truth.points[5].position_world);
  EXPECT_TRUE(result.point_covariances[5].array().isNaN().all());
  EXPECT_TRUE(result.point_covariances[6].array().isNaN().all());
  EXPECT_TRUE(result.plane_covariances.back().array().isNaN().all());
  EXPECT_TRUE(result.pose_covariances[1].allFinite());
  EXPECT_TRUE(result.point_covariances[4].allFinite());
  BundleProblem empty;
  empty.cameras.push_back({{}, true});
  const auto nothing = optimise(empty, world.camera, options);
  EXPECT_EQ(nothing.degrees_of_freedom, 0);
}

TEST(BundleAdjustment, DenseAndSparseAgreeAndTwoRunsGiveTheSameBits) {
  const auto world = test::make_world({.cameras = 8, .points = 100});
  const auto run = [&](int dense_cameras) {
    auto options = plain();
    options.dense_cameras = dense_cameras;
    BundleProblem problem = perturbed(world.truth, 0.03, 7);
    optimise(problem, world.camera, options);
    return problem;
  };
  const auto dense = run(60), again = run(60), sparse = run(1), sparse_again = run(1);
  EXPECT_LT(worst_camera(dense, sparse), 1e-3);
  const auto same = [](const BundleProblem& a, const BundleProblem& b) {
    bool equal = true;
    for (std::size_t i = 0; i < a.cameras.size(); ++i) {
      equal = equal &&
              a.cameras[i].T_camera_world.rotation.coeffs() ==
                  b.cameras[i].T_camera_world.rotation.coeffs() &&
              a.cameras[i].T_camera_world.translation == b.cameras[i].T_camera_world.translation;
    }
    for (std::size_t i = 0; i < a.points.size(); ++i) {
      equal = equal && a.points[i].position_world == b.points[i].position_world;
    }
    for (std::size_t i = 0; i < a.planes.size(); ++i) {
      equal = equal && a.planes[i].normal_world == b.planes[i].normal_world &&
              a.planes[i].distance_m == b.planes[i].distance_m;
    }
    return equal;
  };
  EXPECT_TRUE(same(dense, again));
  EXPECT_TRUE(same(sparse, sparse_again));
}

TEST(BundleAdjustment, WhatCannotBeIsRefused) {
  const auto world = test::make_world({.cameras = 3, .points = 20});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refuses = [&](const auto& spoil) {
    BundleProblem problem = world.truth;
    problem.objects.push_back({});
    problem.object_observations.push_back({0, 0, {}, Matrix6d::Identity()});
    problem.relative_poses.push_back({0, 1, {}, Matrix6d::Identity()});
    spoil(problem);
    EXPECT_THROW(optimise(problem, world.camera, plain()), Error);
  };
  refuses([&](BundleProblem& p) { p.cameras[0].fixed = false; });
  refuses([&](BundleProblem& p) { p.cameras[1].T_camera_world.translation.x() = nan; });
  refuses([&](BundleProblem& p) { p.points[1].position_world.x() = nan; });
  refuses([&](BundleProblem& p) { p.planes[0].distance_m = nan; });
  refuses([&](BundleProblem& p) { p.point_observations[0].camera = 3; });
  refuses([&](BundleProblem& p) { p.point_observations[0].point = -1; });
  refuses([&](BundleProblem& p) { p.point_observations[0].sigma_px = -1.0; });
  refuses([&](BundleProblem& p) { p.plane_observations[0].camera = -1; });
  refuses([&](BundleProblem& p) { p.plane_observations[0].covariance.setConstant(nan); });
  refuses([&](BundleProblem& p) { p.object_observations[0].object = 1; });
  refuses([&](BundleProblem& p) { p.object_observations[0].information(2, 2) = -1.0; });
  refuses([&](BundleProblem& p) { p.objects[0].T_world_object.translation.x() = nan; });
  refuses([&](BundleProblem& p) { p.relative_poses[0].camera_b = 0; });
  refuses([&](BundleProblem& p) { p.relative_poses[0].T_a_b.rotation.coeffs().setConstant(nan); });
}

}  // namespace
}  // namespace weft::slam
