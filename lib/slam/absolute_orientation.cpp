#include "slam/absolute_orientation.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "base/error.hpp"
#include "base/random.hpp"
#include "slam/chi_squared.hpp"

namespace weft::slam {
namespace {

// What is known less well than this (standard deviation in rad and m) counts as not determined.
constexpr double kUndetermined = 0.5;

double chi_squared(const PointPair& pair, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
  return (pair.point_a - R * pair.point_b - t).squaredNorm() / (pair.sigma_m * pair.sigma_m);
}

double chi_squared(const PlanePair& pair, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
  const Eigen::Vector3d n = R * pair.normal_b;
  const double tilt = (pair.normal_a - n).norm() / pair.sigma_tilt_rad;
  const double distance =
      (pair.distance_a_m - pair.distance_b_m - n.dot(t)) / pair.sigma_distance_m;
  return tilt * tilt + distance * distance;
}

void check(std::span<const PointPair> points, std::span<const PlanePair> planes) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    const PointPair& p = points[i];
    if (!p.point_a.allFinite() || !p.point_b.allFinite() || !std::isfinite(p.sigma_m) ||
        !(p.sigma_m > 0.0)) {
      throw Error("absolute orientation: point pair " + std::to_string(i) +
                  " is not finite with a positive deviation");
    }
  }
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const PlanePair& p = planes[i];
    if (!(std::abs(p.normal_a.norm() - 1.0) < 1e-6) ||
        !(std::abs(p.normal_b.norm() - 1.0) < 1e-6) || !std::isfinite(p.distance_a_m) ||
        !std::isfinite(p.distance_b_m) || !std::isfinite(p.sigma_tilt_rad) ||
        !(p.sigma_tilt_rad > 0.0) || !std::isfinite(p.sigma_distance_m) ||
        !(p.sigma_distance_m > 0.0)) {
      throw Error("absolute orientation: plane pair " + std::to_string(i) +
                  " is not finite with unit normals and positive deviations");
    }
  }
}

std::optional<Rigid3d> solve(std::span<const PointPair> points, std::span<const PlanePair> planes) {
  double weight_sum = 0.0;
  Eigen::Vector3d centre_a = Eigen::Vector3d::Zero(), centre_b = Eigen::Vector3d::Zero();
  for (const PointPair& p : points) {
    const double weight = 1.0 / (p.sigma_m * p.sigma_m);
    weight_sum += weight;
    centre_a += weight * p.point_a;
    centre_b += weight * p.point_b;
  }
  if (weight_sum > 0.0) {
    centre_a /= weight_sum;
    centre_b /= weight_sum;
  }
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (const PointPair& p : points) {
    correlation +=
        (p.point_a - centre_a) * (p.point_b - centre_b).transpose() / (p.sigma_m * p.sigma_m);
  }
  for (const PlanePair& p : planes) {
    correlation += p.normal_a * p.normal_b.transpose() / (p.sigma_tilt_rad * p.sigma_tilt_rad);
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(correlation,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  // The information about turning about the axis that is told worst.
  const double least = 1.0 / (kUndetermined * kUndetermined);
  if (!(svd.singularValues()[1] + sign * svd.singularValues()[2] > least)) return std::nullopt;
  const Eigen::Matrix3d R =
      svd.matrixU() * Eigen::Vector3d(1.0, 1.0, sign).asDiagonal() * svd.matrixV().transpose();

  Eigen::Matrix3d information = weight_sum * Eigen::Matrix3d::Identity();
  Eigen::Vector3d pull = weight_sum * (centre_a - R * centre_b);
  for (const PlanePair& p : planes) {
    const Eigen::Vector3d n = R * p.normal_b;
    const double weight = 1.0 / (p.sigma_distance_m * p.sigma_distance_m);
    information += weight * n * n.transpose();
    pull += weight * (p.distance_a_m - p.distance_b_m) * n;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> modes(information);
  if (!(modes.eigenvalues()[0] > least)) return std::nullopt;
  const Eigen::Vector3d t =
      modes.eigenvectors() *
      (modes.eigenvectors().transpose() * pull).cwiseQuotient(modes.eigenvalues());
  return Rigid3d{Eigen::Quaterniond(R).normalized(), t};
}

/// How many of each a minimal sample takes.
struct Sample {
  int points, planes;
};

template <std::size_t N>
void draw(Random& random, std::size_t count, int wanted, std::array<std::size_t, N>& out) {
  for (int i = 0; i < wanted; ++i) {
    const auto at = static_cast<std::size_t>(i);
    do {
      out[at] = random.below(count);
    } while (std::find(out.begin(), out.begin() + i, out[at]) != out.begin() + i);
  }
}

/// Two points are as far apart in both frames, as far as their noise lets tell.
bool rigid(const PointPair& p, const PointPair& q) {
  const double difference = (p.point_a - q.point_a).norm() - (p.point_b - q.point_b).norm();
  const double variance = p.sigma_m * p.sigma_m + q.sigma_m * q.sigma_m;
  return difference * difference <= 9.0 * variance;
}

}  // namespace

std::optional<Rigid3d> absolute_orientation(std::span<const PointPair> points,
                                            std::span<const PlanePair> planes) {
  check(points, planes);
  return solve(points, planes);
}

std::optional<RansacResult> ransac_absolute_orientation(std::span<const PointPair> points,
                                                        std::span<const PlanePair> planes,
                                                        const RansacOptions& options) {
  options.validate();
  check(points, planes);
  std::vector<Sample> samples;
  for (const Sample s : {Sample{3, 0}, Sample{1, 2}, Sample{2, 1}, Sample{0, 3}}) {
    if (points.size() >= static_cast<std::size_t>(s.points) &&
        planes.size() >= static_cast<std::size_t>(s.planes)) {
      samples.push_back(s);
    }
  }
  const double limit = chi_squared_95(3);
  RansacResult best;
  double best_cost = limit * static_cast<double>(points.size() + planes.size());
  bool found = false;
  // Logarithm of the probability that all samples so far held an outlier, were the inliers those
  // of the best motion.
  std::vector<int> drawn(samples.size(), 0);
  std::vector<double> log_failure(samples.size(), 0.0);
  Random random(static_cast<std::uint64_t>(options.seed));
  std::vector<PointPair> sample_points;
  std::vector<PlanePair> sample_planes;
  int iteration = 0;
  const double enough = std::log1p(-std::min(options.confidence, 1.0 - 1e-12));
  while (!samples.empty() && iteration < options.max_iterations) {
    double failure = 0.0;
    for (std::size_t k = 0; k < samples.size(); ++k) failure += drawn[k] * log_failure[k];
    if (failure < enough) break;
    const std::size_t kind = static_cast<std::size_t>(iteration) % samples.size();
    ++iteration;
    ++drawn[kind];
    std::array<std::size_t, 3> point{}, plane{};
    draw(random, points.size(), samples[kind].points, point);
    draw(random, planes.size(), samples[kind].planes, plane);
    sample_points.clear();
    sample_planes.clear();
    bool possible = true;
    for (int i = 0; i < samples[kind].points; ++i) {
      const PointPair& p = points[point[static_cast<std::size_t>(i)]];
      for (const PointPair& q : sample_points) possible = possible && rigid(p, q);
      sample_points.push_back(p);
    }
    if (!possible) continue;
    for (int i = 0; i < samples[kind].planes; ++i) {
      sample_planes.push_back(planes[plane[static_cast<std::size_t>(i)]]);
    }
    const auto T = solve(sample_points, sample_planes);
    if (!T) continue;
    const Eigen::Matrix3d R = T->rotation.toRotationMatrix();
    double cost = 0.0;
    for (const PlanePair& p : planes) cost += std::min(limit, chi_squared(p, R, T->translation));
    for (std::size_t i = 0; i < points.size() && cost < best_cost; ++i) {
      cost += std::min(limit, chi_squared(points[i], R, T->translation));
    }
    if (!(cost < best_cost)) continue;
    best_cost = cost;
    found = true;
    best.T_a_b = *T;
    const auto inliers = [&](const auto& pairs) {
      return std::count_if(pairs.begin(), pairs.end(), [&](const auto& p) {
        return chi_squared(p, R, T->translation) <= limit;
      });
    };
    const auto share = [](std::ptrdiff_t some, std::size_t all) {
      return all == 0 ? 0.0 : static_cast<double>(some) / static_cast<double>(all);
    };
    const auto point_inliers = inliers(points), plane_inliers = inliers(planes);
    // A sample always agrees with itself: as evidence that it is right, others must.
    const auto agreeing = point_inliers + plane_inliers;
    if (point_inliers < options.min_points ||
        (agreeing <= samples[kind].points + samples[kind].planes &&
         agreeing < static_cast<std::ptrdiff_t>(points.size() + planes.size()))) {
      continue;
    }
    const double point_share = share(point_inliers, points.size());
    const double plane_share = share(plane_inliers, planes.size());
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const double good =
          std::pow(point_share, samples[k].points) * std::pow(plane_share, samples[k].planes);
      log_failure[k] = std::log1p(-std::min(good, 1.0 - 1e-12));
    }
  }
  if (!found) return std::nullopt;

  // Least squares over the inliers until they stay the same.
  const auto classify = [&](const Rigid3d& T) {
    const Eigen::Matrix3d R = T.rotation.toRotationMatrix();
    std::vector<std::uint8_t> point_inlier(points.size()), plane_inlier(planes.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      point_inlier[i] = chi_squared(points[i], R, T.translation) <= limit;
    }
    for (std::size_t i = 0; i < planes.size(); ++i) {
      plane_inlier[i] = chi_squared(planes[i], R, T.translation) <= limit;
    }
    return std::pair(point_inlier, plane_inlier);
  };
  auto inliers = classify(best.T_a_b);
  for (int round = 0; round < 10; ++round) {
    sample_points.clear();
    sample_planes.clear();
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (inliers.first[i]) sample_points.push_back(points[i]);
    }
    for (std::size_t i = 0; i < planes.size(); ++i) {
      if (inliers.second[i]) sample_planes.push_back(planes[i]);
    }
    const auto T = solve(sample_points, sample_planes);
    if (!T) return std::nullopt;
    best.T_a_b = *T;
    auto again = classify(*T);
    const bool settled = again == inliers;
    inliers = std::move(again);
    if (settled) break;
  }
  best.point_inlier = std::move(inliers.first);
  best.plane_inlier = std::move(inliers.second);
  best.point_inliers =
      static_cast<int>(std::count(best.point_inlier.begin(), best.point_inlier.end(), 1));
  best.plane_inliers =
      static_cast<int>(std::count(best.plane_inlier.begin(), best.plane_inlier.end(), 1));
  best.iterations = iteration;
  if (best.point_inliers < options.min_points) return std::nullopt;
  return best;
}

}  // namespace weft::slam
