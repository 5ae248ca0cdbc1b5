#include "slam/map_copy.hpp"

#include <algorithm>
#include <string>

#include "base/error.hpp"
#include "slam/plane_gate.hpp"

namespace weft::slam {
namespace {

// An id below kNoId is made of the key frame's number and the index there.
constexpr Id kPerKeyFrame = 1 << 20;
Id waiting_id(std::int64_t number, std::size_t index) {
  return -2 - (number * kPerKeyFrame + static_cast<Id>(index));
}
std::int64_t number_of(Id id) { return (-2 - id) / kPerKeyFrame; }
std::size_t index_of(Id id) { return static_cast<std::size_t>((-2 - id) % kPerKeyFrame); }

}  // namespace

MapCopy::MapCopy(std::shared_ptr<const BinaryVocabulary> vocabulary, const Pyramid& pyramid)
    : vocabulary_(std::move(vocabulary)), pyramid_(pyramid) {
  if (vocabulary_) places_.emplace(vocabulary_->words());
}

void MapCopy::update(const MapUpdate& update, std::vector<PlacedFrame*> held) {
  const bool whole = update.from_version == 0;
  if (!whole && update.to_version <= map_.version) return;
  if (!whole && update.from_version != map_.version)
    throw Error("map update from version " + std::to_string(update.from_version) +
                " does not follow version " + std::to_string(map_.version) +
                "; ask the mapper for the whole map");
  for (auto& each : pending_) held.push_back(&each.frame);
  for (auto* frame : held) frame->anchor.follow(update, map_);
  apply(update, map_);
  if (places_) {
    if (whole)
      places_.emplace(vocabulary_->words());
    else
      for (const Id id : update.removed_key_frames) places_->remove(id);
    for (const auto& key_frame : update.new_key_frames) {
      std::vector<Descriptor> descriptors;
      descriptors.reserve(key_frame.features.size());
      for (const auto& feature : key_frame.features) descriptors.push_back(feature.descriptor);
      places_->add(key_frame.id, vocabulary_->describe(descriptors, 1).bag);
    }
  }

  // Those the mapper has seen: their key frame, or nullptr where it made none of it.
  std::map<std::int64_t, const KeyFrame*> answered;
  for (const auto& each : pending_)
    if (each.frame.input.frame <= update.frame) answered[each.number] = nullptr;
  for (const auto& each : pending_)
    for (const auto& [id, key_frame] : map_.key_frames)
      if (key_frame.frame == each.frame.input.frame) answered[each.number] = &key_frame;
  const auto translate = [&](std::vector<Id>& ids, auto in_key_frame) {
    for (Id& id : ids) {
      if (id >= kNoId) continue;
      const auto found = answered.find(number_of(id));
      if (found == answered.end()) continue;
      id = found->second == nullptr ? kNoId : in_key_frame(*found->second, index_of(id));
    }
  };
  for (auto* frame : held) {
    translate(frame->points, [](const KeyFrame& key_frame, std::size_t index) {
      return index < key_frame.points.size() ? key_frame.points[index] : kNoId;
    });
    translate(frame->planes, [](const KeyFrame& key_frame, std::size_t index) {
      return index < key_frame.planes.size() ? key_frame.planes[index].plane : kNoId;
    });
    frame->T_camera_world = frame->anchor.T_camera_world(map_);
  }
  std::erase_if(pending_, [&](const Pending& each) { return answered.contains(each.number); });
  for (auto& each : pending_) place(each);
}

void MapCopy::wait_for(PlacedFrame& key_frame) {
  Pending pending;
  pending.number = next_number_++;
  for (std::size_t i = 0; i < key_frame.points.size(); ++i) {
    if (key_frame.points[i] != kNoId || !(key_frame.input.features[i].depth_m > 0.0f)) continue;
    key_frame.points[i] = waiting_id(pending.number, i);
    pending.points[i].id = key_frame.points[i];
  }
  for (std::size_t i = 0; i < key_frame.planes.size(); ++i) {
    if (key_frame.planes[i] != kNoId) continue;
    key_frame.planes[i] = waiting_id(pending.number, i);
    pending.planes[i];
  }
  pending.frame = key_frame;
  pending_.push_back(std::move(pending));
  place(pending_.back());
}

// Puts what is new in a key frame where its pose says.
void MapCopy::place(Pending& pending) const {
  const PlacedFrame& frame = pending.frame;
  const Rigid3d T_world_camera = frame.T_camera_world.inverse();
  for (auto& [index, point] : pending.points) {
    const Feature& feature = frame.input.features[index];
    const Eigen::Vector3d point_camera =
        frame.input.camera.unproject(feature.u_px, feature.v_px, feature.depth_m);
    point.position_world = T_world_camera * point_camera;
    point.viewing_direction = T_world_camera.rotation * point_camera.normalized();
    std::tie(point.min_distance_m, point.max_distance_m) =
        scale_range_m(point_camera.norm(), feature.level, pyramid_.levels, pyramid_.scale);
    point.descriptor = feature.descriptor;
  }
  for (auto& [index, plane] : pending.planes) {
    const auto& segment = frame.input.planes[index];
    plane.state = in_world(segment.plane, frame.T_camera_world);
    plane.covariance = covariance_in_world(segment.plane, segment.covariance, frame.T_camera_world,
                                           Matrix6d::Zero());
  }
}

const MapCopy::Pending* MapCopy::pending(Id id) const {
  const auto number = number_of(id);
  for (const auto& each : pending_)
    if (each.number == number) return &each;
  return nullptr;
}

std::optional<LocalPoint> MapCopy::point(Id id) const {
  if (id >= 0) {
    const auto found = map_.points.find(id);
    if (found == map_.points.end()) return std::nullopt;
    return local_point(found->second);
  }
  const Pending* from = id < kNoId ? pending(id) : nullptr;
  if (from == nullptr) return std::nullopt;
  const auto found = from->points.find(index_of(id));
  if (found == from->points.end()) return std::nullopt;
  return found->second;
}

std::optional<KnownPlane> MapCopy::plane(Id id) const {
  if (id >= 0) {
    const auto found = map_.planes.find(id);
    if (found == map_.planes.end()) return std::nullopt;
    const MapPlane& plane = found->second;
    return KnownPlane{{plane.normal_world, plane.distance_m, false}, plane.covariance};
  }
  const Pending* from = id < kNoId ? pending(id) : nullptr;
  if (from == nullptr) return std::nullopt;
  const auto found = from->planes.find(index_of(id));
  if (found == from->planes.end()) return std::nullopt;
  return found->second;
}

std::vector<std::pair<Id, KnownPlane>> MapCopy::planes() const {
  std::vector<std::pair<Id, KnownPlane>> out;
  for (const auto& [id, plane] : map_.planes) out.emplace_back(id, *this->plane(id));
  for (const auto& each : pending_)
    for (const auto& [index, plane] : each.planes)
      out.emplace_back(waiting_id(each.number, index), plane);
  return out;
}

std::vector<LocalPoint> MapCopy::waiting_points() const {
  std::vector<LocalPoint> out;
  for (const auto& each : pending_)
    for (const auto& [index, point] : each.points) out.push_back(point);
  return out;
}

}  // namespace weft::slam
