#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/options.hpp"
#include "slam/rigid3d.hpp"

/// The rigid motion between two views from matched points in space and matched planes.
namespace weft::slam {

struct PointPair {
  Eigen::Vector3d point_a = Eigen::Vector3d::Zero();  // m
  Eigen::Vector3d point_b = Eigen::Vector3d::Zero();
  double sigma_m = 0.01;  // standard deviation of each coordinate of their difference, > 0
};

/// The same plane in both frames, normal . x = distance_m, the normals pointing to the same side
/// of it.
struct PlanePair {
  Eigen::Vector3d normal_a = Eigen::Vector3d::UnitZ();  // of unit length
  double distance_a_m = 0.0;
  Eigen::Vector3d normal_b = Eigen::Vector3d::UnitZ();
  double distance_b_m = 0.0;
  double sigma_tilt_rad = 0.01;  // standard deviations of the differences, > 0
  double sigma_distance_m = 0.02;
};

/// The T_a_b of least weighted squares: rotation from the points about their weighted centroid and
/// the normals (Horn 1987, Umeyama 1991, without scale), then the translation from points and
/// distances. Exact for exact pairs. nullopt when they do not determine all six directions
/// (needed: three points not in a line; three planes with independent normals; two such planes
/// and a point; a plane and two points whose line does not stand upright on it).
std::optional<Rigid3d> absolute_orientation(std::span<const PointPair> points,
                                            std::span<const PlanePair> planes);

struct RansacOptions {
  int max_iterations = 300;
  double confidence = 0.999;
  int min_points = 10;
  int seed = 1;

  void visit(OptionVisitor& v) {
    v.field("max_iterations", max_iterations, {1, 100000}, "", "samples drawn at most");
    v.field("confidence", confidence, {0.5, 1.0}, "",
            "stop when a better sample would have been drawn with this probability");
    v.field("min_points", min_points, {0, 100000}, "", "inlier points of an accepted motion");
    v.field("seed", seed, {0, 1 << 30}, "", "of the samples");
  }
  void validate() const { validate_fields(*this, "RansacOptions"); }
};

struct RansacResult {
  Rigid3d T_a_b;
  std::vector<std::uint8_t> point_inlier;  // 1 or 0 for each pair
  std::vector<std::uint8_t> plane_inlier;
  int point_inliers = 0;
  int plane_inliers = 0;
  int iterations = 0;
};

/// RANSAC over minimal samples of points, of planes, and of both in turns; a sample's cost is the
/// sum of the truncated chi-squared distances of all pairs; the best is refined on its inliers (95
/// % chi-squared test). nullopt when no sample has min_points inlier points and determines the
/// motion. The same result each time. Throws Error on values that are not finite.
std::optional<RansacResult> ransac_absolute_orientation(std::span<const PointPair> points,
                                                        std::span<const PlanePair> planes,
                                                        const RansacOptions& options = {});

}  // namespace weft::slam
