#include "slam/plane_matching.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "rgbd/frame.hpp"
#include "slam/assignment.hpp"
#include "slam/plane_gate.hpp"
#include "slam/sensor_noise.hpp"

namespace weft::slam {
namespace {

// The segment's points, or the foot of the perpendicular where it has none.
double mean_distance_m(const plane::PlaneSegment& segment, const rgbd::Plane& plane_camera) {
  if (segment.points_camera.empty())
    return std::abs(plane_camera.height_m(segment.plane.distance_m * segment.plane.normal));
  double sum = 0.0;
  for (const auto& point : segment.points_camera)
    sum += std::abs(plane_camera.height_m(point.cast<double>()));
  return sum / static_cast<double>(segment.points_camera.size());
}

}  // namespace

std::vector<int> match_planes(std::span<const plane::PlaneSegment> segments,
                              std::span<const KnownPlane> known, const Rigid3d& T_camera_world,
                              const Matrix6d& pose_covariance, const PlaneMatchOptions& options) {
  options.validate();
  const double min_cosine = std::cos(options.max_angle_deg * std::numbers::pi / 180.0);
  Eigen::MatrixXd costs = Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(segments.size()),
                                                    static_cast<Eigen::Index>(known.size()),
                                                    std::numeric_limits<double>::infinity());
  for (std::size_t k = 0; k < known.size(); ++k) {
    const PlaneState& state = known[k].state;
    const rgbd::Plane expected = in_camera(state, T_camera_world);
    // Seen from behind it would be another surface: the other side of a board.
    if (expected.normal.dot(T_camera_world.rotation * state.normal_world) < 0.0) continue;
    for (std::size_t s = 0; s < segments.size(); ++s) {
      if (segments[s].plane.normal.dot(expected.normal) < min_cosine) continue;
      if (mean_distance_m(segments[s], expected) > options.max_distance_m) continue;
      const double distance = plane_distance(state, known[k].covariance, observe(segments[s]),
                                             T_camera_world, pose_covariance, options.noise);
      if (distance <= options.max_chi_squared)
        costs(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(k)) = distance;
    }
  }
  return assign(costs, options.max_chi_squared);
}

}  // namespace weft::slam
