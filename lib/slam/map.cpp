#include "slam/map.hpp"

#include <algorithm>
#include <string>

#include "base/error.hpp"

namespace weft::slam {
namespace {

[[noreturn]] void fail(const char* what, Id id) {
  throw Error(std::string("map update: ") + what + " " + std::to_string(id));
}

KeyFrame& key_frame_of(Map& map, Id id) {
  const auto found = map.key_frames.find(id);
  if (found == map.key_frames.end()) fail("names a key frame that is not there,", id);
  return found->second;
}

// Sets (or, with kNoId, clears) what the key frames say about a landmark's observations. Clearing
// passes over key frames that have gone.
void link_point(Map& map, const MapPoint& point, Id id) {
  for (const auto& observation : point.observations) {
    const auto found = map.key_frames.find(observation.key_frame);
    if (found == map.key_frames.end()) {
      if (id == kNoId) continue;
      fail("names a key frame that is not there, of point", id);
    }
    auto& points = found->second.points;
    if (observation.index < 0 || observation.index >= static_cast<int>(points.size()))
      fail("names a feature that is not there, of point", point.id);
    points[static_cast<std::size_t>(observation.index)] = id;
  }
}

void link_plane(Map& map, const MapPlane& plane, Id id) {
  for (const auto& observation : plane.observations) {
    const auto found = map.key_frames.find(observation.key_frame);
    if (found == map.key_frames.end()) {
      if (id == kNoId) continue;
      fail("names a key frame that is not there, of plane", id);
    }
    auto& planes = found->second.planes;
    if (observation.index < 0 || observation.index >= static_cast<int>(planes.size()))
      fail("names a sighting that is not there, of plane", plane.id);
    planes[static_cast<std::size_t>(observation.index)].plane = id;
  }
}

}  // namespace

void apply(const MapUpdate& update, Map& map) {
  if (update.from_version == 0)
    map = Map{};
  else if (update.from_version != map.version)
    throw Error("map update from version " + std::to_string(update.from_version) +
                " does not follow version " + std::to_string(map.version) +
                "; ask the mapper for the whole map");

  // All old links go before any new one comes: landmarks exchange observations.
  const auto unlink_point = [&map](Id id) {
    if (const auto old = map.points.find(id); old != map.points.end())
      link_point(map, old->second, kNoId);
  };
  const auto unlink_plane = [&map](Id id) {
    if (const auto old = map.planes.find(id); old != map.planes.end())
      link_plane(map, old->second, kNoId);
  };
  for (const Id id : update.removed_points) unlink_point(id);
  for (const auto& point : update.points) unlink_point(point.id);
  for (const Id id : update.removed_planes) unlink_plane(id);
  for (const auto& plane : update.planes) unlink_plane(plane.id);

  for (const Id id : update.removed_key_frames) map.key_frames.erase(id);
  for (const auto& key_frame : update.new_key_frames) {
    auto& placed = map.key_frames[key_frame.id] = key_frame;
    placed.points.assign(placed.features.size(), kNoId);
    for (auto& sighting : placed.planes) sighting.plane = kNoId;
  }
  for (const auto& change : update.key_frames) {
    auto& key_frame = key_frame_of(map, change.id);
    key_frame.T_camera_world = change.T_camera_world;
    key_frame.keep = change.keep;
    key_frame.parent = change.parent;
    key_frame.loop_partners = change.loop_partners;
  }
  for (const Id id : update.removed_points) map.points.erase(id);
  for (const auto& point : update.points) {
    link_point(map, point, point.id);
    map.points[point.id] = point;
  }
  for (const Id id : update.removed_planes) map.planes.erase(id);
  for (const auto& plane : update.planes) {
    link_plane(map, plane, plane.id);
    map.planes[plane.id] = plane;
  }
  map.version = update.to_version;
}

MapUpdate whole_map(const Map& map, std::int64_t frame) {
  MapUpdate update;
  update.to_version = map.version;
  update.frame = frame;
  for (const auto& [id, key_frame] : map.key_frames) update.new_key_frames.push_back(key_frame);
  for (const auto& [id, point] : map.points) update.points.push_back(point);
  for (const auto& [id, plane] : map.planes) update.planes.push_back(plane);
  return update;
}

std::vector<Neighbour> neighbours(const Map& map, const KeyFrame& key_frame, int min_shared) {
  std::map<Id, int> shared;
  for (const Id id : key_frame.points) {
    if (id == kNoId) continue;
    for (const auto& observation : map.points.at(id).observations) ++shared[observation.key_frame];
  }
  shared.erase(key_frame.id);
  std::vector<Neighbour> out;
  for (const auto& [id, count] : shared)
    if (count >= min_shared) out.push_back({id, count});
  std::stable_sort(out.begin(), out.end(),
                   [](const Neighbour& a, const Neighbour& b) { return a.shared > b.shared; });
  return out;
}

}  // namespace weft::slam
