#include "slam/map_editor.hpp"

#include <algorithm>
#include <string>

#include "base/error.hpp"

namespace weft::slam {
namespace {

template <class Landmarks>
auto& at(Landmarks& landmarks, Id id, const char* what) {
  const auto found = landmarks.find(id);
  if (found == landmarks.end())
    throw Error("map: there is no " + std::string(what) + " " + std::to_string(id));
  return found->second;
}

void check_index(int index, std::size_t size, const char* what, Id key_frame) {
  if (index < 0 || static_cast<std::size_t>(index) >= size) {
    throw Error("map: key frame " + std::to_string(key_frame) + " has no " + what + " " +
                std::to_string(index));
  }
}

}  // namespace

MapEditor::MapEditor(Map map, const NextIds& next) : map_(std::move(map)), next_(next) {
  const auto check = [](const auto& landmarks, Id bound, const char* what) {
    if (!landmarks.empty() && (landmarks.begin()->first < 0 || landmarks.rbegin()->first >= bound))
      throw Error("map: a " + std::string(what) + "'s id is not below the next one, " +
                  std::to_string(bound));
  };
  check(map_.key_frames, next_.key_frame, "key frame");
  check(map_.points, next_.point, "point");
  check(map_.planes, next_.plane, "plane");
}

const KeyFrame& MapEditor::key_frame(Id id) const { return at(map_.key_frames, id, "key frame"); }
const MapPoint& MapEditor::point(Id id) const { return at(map_.points, id, "point"); }
const MapPlane& MapEditor::plane(Id id) const { return at(map_.planes, id, "plane"); }
KeyFrame& MapEditor::find_key_frame(Id id) { return at(map_.key_frames, id, "key frame"); }
MapPoint& MapEditor::find_point(Id id) { return at(map_.points, id, "point"); }
MapPlane& MapEditor::find_plane(Id id) { return at(map_.planes, id, "plane"); }

void MapEditor::remember_pose(const KeyFrame& key_frame) {
  if (!new_key_frames_.contains(key_frame.id))
    past_[map_.version + 1].poses.emplace(key_frame.id, key_frame.T_camera_world);
}

Id MapEditor::add_key_frame(KeyFrame key_frame) {
  const Id id = next_.key_frame++;
  key_frame.id = id;
  key_frame.points.assign(key_frame.features.size(), kNoId);
  for (auto& sighting : key_frame.planes) sighting.plane = kNoId;
  map_.key_frames.emplace_hint(map_.key_frames.end(), id, std::move(key_frame));
  new_key_frames_.insert(id);
  return id;
}

void MapEditor::set_pose(Id id, const Rigid3d& T_camera_world) {
  KeyFrame& key_frame = find_key_frame(id);
  remember_pose(key_frame);
  key_frame.T_camera_world = T_camera_world;
  changed_key_frames_.insert(id);
}

void MapEditor::set_keep(Id id, bool keep) {
  find_key_frame(id).keep = keep;
  changed_key_frames_.insert(id);
}

void MapEditor::set_parent(Id id, Id parent) {
  if (id == parent) throw Error("map: key frame " + std::to_string(id) + " cannot be its parent");
  find_key_frame(id).parent = parent == kNoId ? kNoId : key_frame(parent).id;
  changed_key_frames_.insert(id);
}

void MapEditor::tie(Id a, Id b) {
  KeyFrame& first = find_key_frame(a);
  KeyFrame& second = find_key_frame(b);
  const auto add = [](std::vector<Id>& partners, Id id) {
    const auto place = std::lower_bound(partners.begin(), partners.end(), id);
    if (place == partners.end() || *place != id) partners.insert(place, id);
  };
  add(first.loop_partners, b);
  add(second.loop_partners, a);
  changed_key_frames_.insert({a, b});
}

void MapEditor::remove_key_frame(Id id) {
  KeyFrame& gone = find_key_frame(id);
  const std::vector<Id> seen = gone.points;
  for (const Id point : seen)
    if (point != kNoId) unobserve_point(point, id);
  for (std::size_t i = 0; i < gone.planes.size(); ++i)
    if (gone.planes[i].plane != kNoId)
      unobserve_plane(gone.planes[i].plane, id, static_cast<int>(i));
  for (auto& [other, key_frame] : map_.key_frames) {
    const bool child = key_frame.parent == id;
    if (child) key_frame.parent = gone.parent;
    if (std::erase(key_frame.loop_partners, id) > 0 || child) changed_key_frames_.insert(other);
  }
  remember_pose(gone);
  map_.key_frames.erase(id);
  changed_key_frames_.erase(id);
  if (new_key_frames_.erase(id) == 0) removed_key_frames_.insert(id);
}

Id MapEditor::add_point(const Eigen::Vector3d& position_world, Id first_key_frame) {
  const Id id = next_.point++;
  MapPoint& point = map_.points.emplace_hint(map_.points.end(), id, MapPoint{})->second;
  point.id = id;
  point.position_world = position_world;
  point.first_key_frame = first_key_frame;
  changed_points_.insert(id);
  return id;
}

MapPoint& MapEditor::edit_point(Id id) {
  MapPoint& point = find_point(id);
  changed_points_.insert(id);
  return point;
}

void MapEditor::count(Id id, int visible, int found) {
  MapPoint& point = find_point(id);
  point.visible += visible;
  point.found += found;
}

void MapEditor::observe_point(Id id, Id key_frame_id, int feature) {
  MapPoint& point = find_point(id);
  KeyFrame& key_frame = find_key_frame(key_frame_id);
  check_index(feature, key_frame.points.size(), "feature", key_frame_id);
  Id& seen = key_frame.points[static_cast<std::size_t>(feature)];
  const auto place = std::lower_bound(
      point.observations.begin(), point.observations.end(), key_frame_id,
      [](const Observation& observation, Id sought) { return observation.key_frame < sought; });
  if (seen != kNoId || (place != point.observations.end() && place->key_frame == key_frame_id)) {
    throw Error("map: feature " + std::to_string(feature) + " of key frame " +
                std::to_string(key_frame_id) + " cannot be of point " + std::to_string(id) +
                ": one of them is matched already");
  }
  point.observations.insert(place, {key_frame_id, feature});
  seen = id;
  changed_points_.insert(id);
}

void MapEditor::unobserve_point(Id id, Id key_frame_id) {
  MapPoint& point = find_point(id);
  KeyFrame& key_frame = find_key_frame(key_frame_id);
  const auto place =
      std::find_if(point.observations.begin(), point.observations.end(),
                   [&](const Observation& o) { return o.key_frame == key_frame_id; });
  if (place == point.observations.end()) {
    throw Error("map: key frame " + std::to_string(key_frame_id) + " does not see point " +
                std::to_string(id));
  }
  key_frame.points[static_cast<std::size_t>(place->index)] = kNoId;
  point.observations.erase(place);
  changed_points_.insert(id);
}

void MapEditor::remove_point(Id id) {
  const MapPoint& point = find_point(id);
  for (const auto& [key_frame, feature] : point.observations)
    map_.key_frames.at(key_frame).points[static_cast<std::size_t>(feature)] = kNoId;
  map_.points.erase(id);
  changed_points_.erase(id);
  removed_points_.insert(id);
}

void MapEditor::replace_point(Id id, Id by) {
  const MapPoint old = find_point(id);
  find_point(by);
  if (id == by) throw Error("map: point " + std::to_string(id) + " cannot replace itself");
  remove_point(id);
  const auto& observations = map_.points.at(by).observations;
  for (const Observation& moved : old.observations) {
    const bool seen = std::any_of(observations.begin(), observations.end(),
                                  [&](const auto& o) { return o.key_frame == moved.key_frame; });
    if (!seen) observe_point(by, moved.key_frame, moved.index);
  }
  count(by, old.visible, old.found);
  changed_points_.insert(by);
  past_[map_.version + 1].points_replaced[id] = by;
}

Id MapEditor::add_plane(const Eigen::Vector3d& normal_world, double distance_m) {
  const Id id = next_.plane++;
  MapPlane& plane = map_.planes.emplace_hint(map_.planes.end(), id, MapPlane{})->second;
  plane.id = id;
  plane.normal_world = normal_world;
  plane.distance_m = distance_m;
  changed_planes_.insert(id);
  return id;
}

MapPlane& MapEditor::edit_plane(Id id) {
  MapPlane& plane = find_plane(id);
  changed_planes_.insert(id);
  return plane;
}

void MapEditor::observe_plane(Id id, Id key_frame_id, int segment) {
  MapPlane& plane = find_plane(id);
  KeyFrame& key_frame = find_key_frame(key_frame_id);
  check_index(segment, key_frame.planes.size(), "plane sighting", key_frame_id);
  Id& seen = key_frame.planes[static_cast<std::size_t>(segment)].plane;
  if (seen != kNoId) {
    throw Error("map: sighting " + std::to_string(segment) + " of key frame " +
                std::to_string(key_frame_id) + " is of plane " + std::to_string(seen) + " already");
  }
  const Observation observation{key_frame_id, segment};
  plane.observations.insert(
      std::upper_bound(plane.observations.begin(), plane.observations.end(), observation,
                       [](const Observation& a, const Observation& b) {
                         return std::pair(a.key_frame, a.index) < std::pair(b.key_frame, b.index);
                       }),
      observation);
  seen = id;
  changed_planes_.insert(id);
}

void MapEditor::unobserve_plane(Id id, Id key_frame_id, int segment) {
  MapPlane& plane = find_plane(id);
  KeyFrame& key_frame = find_key_frame(key_frame_id);
  if (std::erase(plane.observations, Observation{key_frame_id, segment}) == 0) {
    throw Error("map: sighting " + std::to_string(segment) + " of key frame " +
                std::to_string(key_frame_id) + " is not of plane " + std::to_string(id));
  }
  key_frame.planes[static_cast<std::size_t>(segment)].plane = kNoId;
  changed_planes_.insert(id);
}

void MapEditor::remove_plane(Id id) {
  const MapPlane& plane = find_plane(id);
  for (const auto& [key_frame, segment] : plane.observations)
    map_.key_frames.at(key_frame).planes[static_cast<std::size_t>(segment)].plane = kNoId;
  map_.planes.erase(id);
  changed_planes_.erase(id);
  removed_planes_.insert(id);
}

void MapEditor::replace_plane(Id id, Id by) {
  const MapPlane old = find_plane(id);
  MapPlane& plane = find_plane(by);
  if (id == by) throw Error("map: plane " + std::to_string(id) + " cannot replace itself");
  remove_plane(id);
  for (const auto& [key_frame, segment] : old.observations) observe_plane(by, key_frame, segment);
  plane.sightings += old.sightings;
  plane.confirmed = plane.confirmed || old.confirmed;
  plane.cloud_world.insert(plane.cloud_world.end(), old.cloud_world.begin(), old.cloud_world.end());
  changed_planes_.insert(by);
}

bool MapEditor::has_changes() const {
  for (const auto* ids :
       {&new_key_frames_, &changed_key_frames_, &changed_points_, &changed_planes_,
        &removed_key_frames_, &removed_points_, &removed_planes_})
    if (!ids->empty()) return true;
  return false;
}

MapUpdate MapEditor::take_update(std::int64_t frame) {
  MapUpdate update;
  update.from_version = map_.version;
  update.to_version = ++map_.version;
  update.frame = frame;
  for (const Id id : new_key_frames_) {
    update.new_key_frames.push_back(key_frame(id));
    changed_key_frames_.erase(id);
  }
  for (const Id id : changed_key_frames_) {
    const KeyFrame& k = key_frame(id);
    update.key_frames.push_back({id, k.T_camera_world, k.keep, k.parent, k.loop_partners});
  }
  for (const Id id : changed_points_) update.points.push_back(point(id));
  for (const Id id : changed_planes_) update.planes.push_back(plane(id));
  update.removed_key_frames.assign(removed_key_frames_.begin(), removed_key_frames_.end());
  update.removed_points.assign(removed_points_.begin(), removed_points_.end());
  update.removed_planes.assign(removed_planes_.begin(), removed_planes_.end());
  for (auto* ids : {&new_key_frames_, &changed_key_frames_, &changed_points_, &changed_planes_,
                    &removed_key_frames_, &removed_points_, &removed_planes_})
    ids->clear();
  past_.erase(past_.begin(), past_.lower_bound(map_.version - kRemembered));
  return update;
}

Id MapEditor::present_point(Id id) const {
  while (id != kNoId && !map_.points.contains(id)) {
    Id next = kNoId;
    for (const auto& [version, past] : past_) {
      const auto found = past.points_replaced.find(id);
      if (found != past.points_replaced.end()) next = found->second;
    }
    id = next;
  }
  return id;
}

bool MapEditor::pose_at(Id id, std::int64_t version, Rigid3d& T_camera_world) const {
  if (version < map_.version - kRemembered) return false;
  for (auto past = past_.upper_bound(version); past != past_.end(); ++past) {
    const auto found = past->second.poses.find(id);
    if (found != past->second.poses.end()) {
      T_camera_world = found->second;
      return true;
    }
  }
  const auto found = map_.key_frames.find(id);
  if (found == map_.key_frames.end()) return false;
  T_camera_world = found->second.T_camera_world;
  return true;
}

}  // namespace weft::slam
