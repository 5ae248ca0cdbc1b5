#include "slam/map_adjustment.hpp"

#include <algorithm>
#include <limits>
#include <map>

#include "slam/sensor_noise.hpp"

namespace weft::slam {
namespace {

/// Indices into the problem's lists.
using Places = std::map<Id, int>;

int place_of(Places& places, Id id) {
  return places.emplace(id, static_cast<int>(places.size())).first->second;
}

/// The points the key frames see, those with most observations first, within the bound.
std::vector<Id> choose_points(const Map& map, const std::set<Id>& key_frames, int max_observations,
                              std::size_t least) {
  std::set<Id> seen;
  for (const Id id : key_frames)
    for (const Id point : map.key_frames.at(id).points)
      if (point != kNoId) seen.insert(point);
  std::vector<std::pair<std::size_t, Id>> by_size;
  for (const Id id : seen) {
    const auto size = map.points.at(id).observations.size();
    if (size >= least) by_size.emplace_back(size, id);
  }
  std::stable_sort(by_size.begin(), by_size.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Id> out;
  std::size_t sum = 0;
  for (const auto& [size, id] : by_size) {
    sum += size;
    if (sum > static_cast<std::size_t>(max_observations)) break;
    out.push_back(id);
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace

std::set<Id> window(const Map& map, Id key_frame, int count) {
  std::set<Id> out{key_frame};
  for (const auto& [id, shared] : neighbours(map, map.key_frames.at(key_frame), 1)) {
    if (static_cast<int>(out.size()) >= count) break;
    out.insert(id);
  }
  return out;
}

AdjustmentReport adjust(MapEditor& editor, const PointMapper& points, const SensorNoise& noise,
                        const std::set<Id>& key_frames, int max_observations,
                        const AdjustmentOptions& options) {
  const Map& map = editor.map();
  AdjustmentReport report;
  if (key_frames.empty()) return report;
  const Id root = map.key_frames.begin()->first;
  const auto point_ids = choose_points(map, key_frames, max_observations, 2);

  // Who else sees them: those that see most.
  std::map<Id, int> others;
  for (const Id id : point_ids)
    for (const auto& observation : map.points.at(id).observations)
      if (!key_frames.contains(observation.key_frame)) ++others[observation.key_frame];
  std::vector<std::pair<Id, int>> by_count(others.begin(), others.end());
  std::stable_sort(by_count.begin(), by_count.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  if (static_cast<int>(by_count.size()) > options.fixed_key_frames)
    by_count.resize(static_cast<std::size_t>(options.fixed_key_frames));
  std::set<Id> fixed;
  for (const auto& [id, count] : by_count) fixed.insert(id);

  BundleProblem problem;
  Places cameras;
  const auto add_camera = [&](Id id, bool is_fixed) {
    place_of(cameras, id);
    problem.cameras.push_back({map.key_frames.at(id).T_camera_world, is_fixed});
  };
  const bool hold_first = fixed.empty() && !key_frames.contains(root);
  for (const Id id : key_frames)
    add_camera(id, id == root || (hold_first && id == *key_frames.begin()));
  for (const Id id : fixed) add_camera(id, true);

  struct Seen {
    Id landmark, key_frame;
  };
  std::vector<Seen> seen_points;
  for (const Id id : point_ids) {
    const MapPoint& point = map.points.at(id);
    const int at = static_cast<int>(problem.points.size());
    problem.points.push_back({point.position_world, false});
    for (const auto& [key_frame, index] : point.observations) {
      const auto camera = cameras.find(key_frame);
      if (camera == cameras.end()) continue;
      const KeyFrame& of = map.key_frames.at(key_frame);
      PointObservation seen = observe(of.features[static_cast<std::size_t>(index)], noise);
      seen.camera = camera->second;
      seen.point = at;
      problem.point_observations.push_back(seen);
      seen_points.push_back({id, key_frame});
    }
  }
  std::vector<Id> plane_ids;
  if (options.use_planes) {
    std::set<Id> seen;
    for (const Id id : key_frames)
      for (const auto& sighting : map.key_frames.at(id).planes)
        if (sighting.plane != kNoId && map.planes.at(sighting.plane).confirmed)
          seen.insert(sighting.plane);
    for (const Id id : seen) {
      const MapPlane& plane = map.planes.at(id);
      const int at = static_cast<int>(problem.planes.size());
      plane_ids.push_back(id);
      problem.planes.push_back({plane.normal_world, plane.distance_m, false});
      for (const auto& [key_frame, index] : plane.observations) {
        // A plane is held by all who see it: few numbers each.
        auto camera = cameras.find(key_frame);
        if (camera == cameras.end()) {
          add_camera(key_frame, true);
          camera = cameras.find(key_frame);
        }
        PlaneObservation observation =
            observe(map.key_frames.at(key_frame).planes[static_cast<std::size_t>(index)].segment);
        observation.camera = camera->second;
        observation.plane = at;
        problem.plane_observations.push_back(observation);
      }
    }
  }

  BundleOptions how = options.bundle;
  how.plane_covariances = !plane_ids.empty() && static_cast<int>(key_frames.size()) <= 60;
  const BundleSummary summary =
      optimise(problem, map.key_frames.at(*key_frames.begin()).camera, how);

  // What took no part goes with the key frame that brought it, or the first of those that see it.
  std::map<Id, Rigid3d> T_new_old;
  for (const Id id : key_frames) {
    const CameraState& camera = problem.cameras[static_cast<std::size_t>(cameras.at(id))];
    if (camera.fixed) continue;
    T_new_old[id] = camera.T_camera_world.inverse() * map.key_frames.at(id).T_camera_world;
    editor.set_pose(id, camera.T_camera_world);
  }
  std::set<Id> left_out;
  for (const auto& [id, motion] : T_new_old)
    for (const Id point : map.key_frames.at(id).points)
      if (point != kNoId && !std::binary_search(point_ids.begin(), point_ids.end(), point))
        left_out.insert(point);
  for (const Id id : left_out) {
    const MapPoint& point = map.points.at(id);
    auto with = T_new_old.find(point.first_key_frame);
    if (with == T_new_old.end()) with = T_new_old.find(point.observations.front().key_frame);
    if (with != T_new_old.end())
      editor.edit_point(id).position_world = with->second * point.position_world;
  }
  for (std::size_t i = 0; i < point_ids.size(); ++i)
    editor.edit_point(point_ids[i]).position_world = problem.points[i].position_world;
  for (std::size_t i = 0; i < plane_ids.size(); ++i) {
    MapPlane& plane = editor.edit_plane(plane_ids[i]);
    plane.normal_world = problem.planes[i].normal_world;
    plane.distance_m = problem.planes[i].distance_m;
    if (how.plane_covariances && summary.plane_covariances[i].allFinite())
      plane.covariance = summary.plane_covariances[i];
  }
  for (std::size_t i = 0; i < seen_points.size(); ++i) {
    if (summary.point_inlier[i] || !map.points.contains(seen_points[i].landmark)) continue;
    points.drop(editor, seen_points[i].landmark, seen_points[i].key_frame);
    ++report.dropped;
  }
  for (const Id id : point_ids)
    if (map.points.contains(id)) points.refresh(editor, id);

  report.key_frames = static_cast<int>(key_frames.size());
  report.fixed_key_frames = static_cast<int>(problem.cameras.size() - key_frames.size());
  report.points = static_cast<int>(point_ids.size());
  report.planes = static_cast<int>(plane_ids.size());
  report.point_observations = static_cast<int>(problem.point_observations.size());
  report.plane_observations = static_cast<int>(problem.plane_observations.size());
  report.chi_squared = summary.chi_squared;
  report.degrees_of_freedom = summary.degrees_of_freedom;
  return report;
}

}  // namespace weft::slam
