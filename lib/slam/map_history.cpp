#include "slam/map_history.hpp"

#include <algorithm>
#include <string>

#include "base/error.hpp"

namespace weft::slam {

void MapHistory::begin(std::int64_t version) {
  *this = MapHistory(max_removed_);
  first_ = version_ = version;
}

void MapHistory::note(Removed& removed, std::int64_t version, const std::vector<Id>& ids) {
  for (const Id id : ids) removed.by_version.emplace_back(version, id);
  while (removed.by_version.size() > max_removed_) {
    first_ = std::max(first_, removed.by_version.front().first);
    removed.by_version.pop_front();
  }
}

void MapHistory::add(const MapUpdate& update) {
  if (update.from_version != version_)
    throw Error("map history: an update from version " + std::to_string(update.from_version) +
                " does not follow version " + std::to_string(version_));
  version_ = update.to_version;
  for (const auto& each : update.new_key_frames) added_[each.id] = changed_[each.id] = version_;
  for (const auto& each : update.key_frames) changed_[each.id] = version_;
  for (const auto& each : update.points) points_[each.id] = version_;
  for (const auto& each : update.planes) planes_[each.id] = version_;
  for (const Id id : update.removed_key_frames) {
    added_.erase(id);
    changed_.erase(id);
  }
  for (const Id id : update.removed_points) points_.erase(id);
  for (const Id id : update.removed_planes) planes_.erase(id);
  note(removed_key_frames_, version_, update.removed_key_frames);
  note(removed_points_, version_, update.removed_points);
  note(removed_planes_, version_, update.removed_planes);
}

MapUpdate MapHistory::since(std::int64_t version, const Map& map, std::int64_t frame) const {
  if (version_ != map.version)
    throw Error("map history: it is at version " + std::to_string(version_) + ", the map at " +
                std::to_string(map.version));
  if (version <= 0 || version < first_ || version > version_) return whole_map(map, frame);
  MapUpdate update;
  update.from_version = version;
  update.to_version = version_;
  update.frame = frame;
  const auto later = [version](const std::map<Id, std::int64_t>& changes, Id id) {
    const auto found = changes.find(id);
    return found != changes.end() && found->second > version;
  };
  for (const auto& [id, key_frame] : map.key_frames) {
    if (later(added_, id))
      update.new_key_frames.push_back(key_frame);
    else if (later(changed_, id))
      update.key_frames.push_back({id, key_frame.T_camera_world, key_frame.keep, key_frame.parent,
                                   key_frame.loop_partners});
  }
  for (const auto& [id, point] : map.points)
    if (later(points_, id)) update.points.push_back(point);
  for (const auto& [id, plane] : map.planes)
    if (later(planes_, id)) update.planes.push_back(plane);
  const auto gone = [version](const Removed& removed, std::vector<Id>& ids) {
    for (const auto& [when, id] : removed.by_version)
      if (when > version) ids.push_back(id);
  };
  gone(removed_key_frames_, update.removed_key_frames);
  gone(removed_points_, update.removed_points);
  gone(removed_planes_, update.removed_planes);
  return update;
}

MapUpdate continued_from(MapUpdate update, const Map& copy) {
  if (update.from_version == 0 || update.from_version > copy.version) return update;
  std::vector<KeyFrame> fresh;
  for (auto& key_frame : update.new_key_frames) {
    if (copy.key_frames.contains(key_frame.id))
      update.key_frames.push_back({key_frame.id, key_frame.T_camera_world, key_frame.keep,
                                   key_frame.parent, key_frame.loop_partners});
    else
      fresh.push_back(std::move(key_frame));
  }
  update.new_key_frames = std::move(fresh);
  std::erase_if(update.removed_key_frames, [&](Id id) { return !copy.key_frames.contains(id); });
  update.from_version = copy.version;
  return update;
}

}  // namespace weft::slam
