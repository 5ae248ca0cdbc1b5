#include "slam/local_map.hpp"

#include <algorithm>
#include <cmath>
#include <unordered_set>

namespace weft::slam {

LocalPoint local_point(const MapPoint& point) {
  return {point.id,
          point.position_world,
          point.viewing_direction,
          point.min_distance_m,
          point.max_distance_m,
          point.descriptor};
}

std::pair<double, double> scale_range_m(double distance_m, int level, int levels, double scale) {
  const double most = distance_m * std::pow(scale, level);
  return {most / std::pow(scale, levels - 1), most};
}

std::vector<Id> local_key_frames(const Map& map, std::span<const Id> points, Id reference,
                                 int most) {
  std::map<Id, int> votes;
  for (const Id id : points) {
    const auto found = map.points.find(id);
    if (found == map.points.end()) continue;
    for (const auto& observation : found->second.observations) ++votes[observation.key_frame];
  }
  if (votes.empty() && map.key_frames.contains(reference)) votes[reference] = 1;
  std::vector<std::pair<Id, int>> ranked(votes.begin(), votes.end());
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  std::vector<Id> out;
  std::unordered_set<Id> in;
  const auto take = [&](Id id) {
    if (static_cast<int>(out.size()) < most && in.insert(id).second) out.push_back(id);
  };
  for (const auto& [id, count] : ranked) take(id);
  constexpr std::size_t kFirst = 3;  // whose neighbours come in
  constexpr int kMinShared = 15, kNeighbours = 10;
  for (std::size_t i = 0; i < std::min(kFirst, ranked.size()); ++i) {
    const auto around = neighbours(map, map.key_frames.at(ranked[i].first), kMinShared);
    for (std::size_t k = 0; k < std::min<std::size_t>(kNeighbours, around.size()); ++k)
      take(around[k].key_frame);
  }
  return out;
}

std::vector<LocalPoint> local_points(const Map& map, std::span<const Id> key_frames) {
  std::vector<LocalPoint> out;
  std::unordered_set<Id> in;
  for (const Id key_frame : key_frames)
    for (const Id id : map.key_frames.at(key_frame).points)
      if (id != kNoId && in.insert(id).second) out.push_back(local_point(map.points.at(id)));
  return out;
}

bool project(const LocalPoint& point, const rgbd::CameraModel& camera,
             const Rigid3d& T_camera_world, const Pyramid& pyramid, double radius_px, Sought& out) {
  constexpr double kMinDepth_m = 0.1, kMinCosine = 0.5;
  const Eigen::Vector3d point_camera = T_camera_world * point.position_world;
  if (point_camera.z() < kMinDepth_m) return false;
  const Eigen::Vector2d pixel = camera.project(point_camera);
  if (pixel.x() < 0.0 || pixel.y() < 0.0 || pixel.x() > camera.width - 1.0 ||
      pixel.y() > camera.height - 1.0)
    return false;
  const double distance = point_camera.norm();
  if (distance < 0.8 * point.min_distance_m || distance > 1.2 * point.max_distance_m) return false;
  const double cosine =
      (T_camera_world.rotation * point.viewing_direction).dot(point_camera) / distance;
  if (cosine < kMinCosine) return false;
  const double exact = std::log(point.max_distance_m / distance) / std::log(pyramid.scale);
  const int level = std::clamp(static_cast<int>(std::lround(exact)), 0, pyramid.levels - 1);
  out.u_px = static_cast<float>(pixel.x());
  out.v_px = static_cast<float>(pixel.y());
  out.radius_px = static_cast<float>(radius_px * std::pow(pyramid.scale, level));
  out.min_level = level - 1;
  out.max_level = level + 1;
  out.descriptor = point.descriptor;
  return true;
}

}  // namespace weft::slam
