#include "messages/map.hpp"

#include <algorithm>
#include <cmath>

#include "messages/planes.hpp"
#include "messages/view.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

using messages::from_message;
using messages::to_message;
using slam::Id;

constexpr std::size_t kDescriptorBytes = sizeof(slam::Descriptor);
constexpr int kMaxLevel = 32;  // of an image pyramid

[[noreturn]] void fail(const std::string& where, const std::string& what) {
  throw stage::InvalidInput(where + ": " + what);
}

Eigen::Vector3d finite(const double (&values)[3], const std::string& where, const char* what) {
  const Eigen::Vector3d v = Eigen::Map<const Eigen::Vector3d>(values);
  if (!v.allFinite()) fail(where, std::string(what) + " is not finite");
  return v;
}

Eigen::Vector3d unit(const double (&values)[3], const std::string& where, const char* what) {
  const Eigen::Vector3d v = Eigen::Map<const Eigen::Vector3d>(values);
  if (!(std::abs(v.norm() - 1.0) <= 1e-6))
    fail(where, std::string(what) + " is not of unit length");
  return v;
}

void copy(const Eigen::Vector3d& from, double (&to)[3]) { std::copy_n(from.data(), 3, to); }

Id id(std::int64_t value, bool may_be_none, const std::string& where, const char* what) {
  if (value < (may_be_none ? slam::kNoId : 0))
    fail(where, std::string(what) + " " + std::to_string(value) + " is no id");
  return value;
}

std::vector<Id> ids(const std::vector<std::int64_t>& values, bool may_be_none,
                    const std::string& where, const char* what) {
  for (const auto value : values) id(value, may_be_none, where, what);
  return values;
}

std::int64_t version(std::int64_t value, const std::string& where, const char* what) {
  if (value < 0) fail(where, std::string(what) + " " + std::to_string(value) + " is negative");
  return value;
}

template <class T>
std::int32_t count(const std::vector<T>& list) {
  return static_cast<std::int32_t>(list.size());
}

features_t to_message(const std::vector<slam::Feature>& features) {
  features_t message{};
  message.count = count(features);
  message.descriptors.reserve(features.size() * kDescriptorBytes);
  for (const auto& feature : features) {
    message.u_px.push_back(feature.u_px);
    message.v_px.push_back(feature.v_px);
    message.depth_m.push_back(feature.depth_m);
    message.angle_deg.push_back(feature.angle_deg);
    message.level.push_back(static_cast<std::int8_t>(feature.level));
    for (const std::uint64_t word : feature.descriptor)
      for (int byte = 0; byte < 8; ++byte)
        message.descriptors.push_back(static_cast<std::uint8_t>(word >> (8 * byte)));
  }
  message.descriptor_size = count(message.descriptors);
  return message;
}

slam::Descriptor descriptor(const std::uint8_t* bytes) {
  slam::Descriptor out{};
  for (std::size_t i = 0; i < kDescriptorBytes; ++i)
    out[i / 8] |= std::uint64_t{bytes[i]} << (8 * (i % 8));
  return out;
}

std::vector<slam::Feature> from_message(const features_t& message, const std::string& where) {
  const std::size_t size = message.u_px.size();
  if (message.descriptors.size() != size * kDescriptorBytes)
    fail(where, std::to_string(message.descriptors.size()) + " bytes of descriptors for " +
                    std::to_string(size) + " features");
  std::vector<slam::Feature> features(size);
  for (std::size_t i = 0; i < size; ++i) {
    slam::Feature& feature = features[i];
    feature.u_px = message.u_px[i];
    feature.v_px = message.v_px[i];
    feature.depth_m = message.depth_m[i];
    feature.angle_deg = message.angle_deg[i];
    feature.level = message.level[i];
    feature.descriptor = descriptor(&message.descriptors[i * kDescriptorBytes]);
    if (!std::isfinite(feature.u_px) || !std::isfinite(feature.v_px) ||
        !(feature.depth_m >= 0.0f) || !std::isfinite(feature.depth_m) ||
        !(feature.angle_deg >= 0.0f && feature.angle_deg <= 360.0f) || feature.level < 0 ||
        feature.level >= kMaxLevel)
      fail(where,
           "feature " + std::to_string(i) + ": its place, depth, angle or level is impossible");
  }
  return features;
}

sightings_t to_message(const std::vector<slam::Sightings>& sightings) {
  sightings_t message{};
  message.sighting_count = count(sightings);
  for (const auto& each : sightings) {
    message.ids.push_back(each.id);
    message.visible.push_back(each.visible);
    message.found.push_back(each.found);
  }
  return message;
}

std::vector<slam::Sightings> from_message(const sightings_t& message, const std::string& where) {
  std::vector<slam::Sightings> sightings;
  for (std::size_t i = 0; i < message.ids.size(); ++i) {
    sightings.push_back(
        {id(message.ids[i], false, where, "sighting of"), message.visible[i], message.found[i]});
    if (message.visible[i] < 0 || message.found[i] < 0)
      fail(where, "sightings of " + std::to_string(message.ids[i]) + ": a negative count");
  }
  return sightings;
}

std::vector<map_observation_t> to_message(const std::vector<slam::Observation>& observations) {
  std::vector<map_observation_t> messages;
  for (const auto& each : observations) {
    map_observation_t message{};
    message.key_frame = each.key_frame;
    message.index = each.index;
    messages.push_back(message);
  }
  return messages;
}

std::vector<slam::Observation> from_message(const std::vector<map_observation_t>& messages,
                                            const std::string& where) {
  std::vector<slam::Observation> observations;
  for (const auto& each : messages) {
    if (each.index < 0) fail(where, "an observation of a negative index");
    observations.push_back(
        {id(each.key_frame, false, where, "observation in key frame"), each.index});
  }
  return observations;
}

map_key_frame_t to_message(const slam::KeyFrame& key_frame) {
  map_key_frame_t message{};
  message.id = key_frame.id;
  message.frame = key_frame.frame;
  message.frame_utime = key_frame.utime;
  message.camera_model = to_message(key_frame.camera);
  message.T_camera_world = to_message(key_frame.T_camera_world);
  message.keep = key_frame.keep ? 1 : 0;
  message.parent = key_frame.parent;
  message.loop_partners = key_frame.loop_partners;
  message.loop_partner_count = count(message.loop_partners);
  message.features = to_message(key_frame.features);
  for (const auto& sighting : key_frame.planes)
    message.planes.push_back(to_message(sighting.segment));
  message.plane_count = count(message.planes);
  return message;
}

slam::KeyFrame from_message(const map_key_frame_t& message, const std::string& in) {
  const std::string where = in + ": key frame " + std::to_string(message.id);
  slam::KeyFrame key_frame;
  key_frame.id = id(message.id, false, where, "id");
  key_frame.frame = message.frame;
  key_frame.utime = message.frame_utime;
  key_frame.camera = from_message(message.camera_model, where);
  key_frame.T_camera_world = from_message(message.T_camera_world, where);
  key_frame.keep = message.keep != 0;
  key_frame.parent = id(message.parent, true, where, "parent");
  key_frame.loop_partners = ids(message.loop_partners, false, where, "loop partner");
  key_frame.features = from_message(message.features, where);
  key_frame.points.assign(key_frame.features.size(), slam::kNoId);
  for (const auto& segment : message.planes)
    key_frame.planes.push_back({from_message(segment, where), slam::kNoId});
  return key_frame;
}

map_key_frame_change_t to_message(const slam::MapUpdate::Change& change) {
  map_key_frame_change_t message{};
  message.id = change.id;
  message.T_camera_world = to_message(change.T_camera_world);
  message.keep = change.keep ? 1 : 0;
  message.parent = change.parent;
  message.loop_partners = change.loop_partners;
  message.loop_partner_count = count(message.loop_partners);
  return message;
}

map_point_t to_message(const slam::MapPoint& point) {
  map_point_t message{};
  message.id = point.id;
  copy(point.position_world, message.position_world_m);
  copy(point.viewing_direction, message.viewing_direction);
  message.min_distance_m = point.min_distance_m;
  message.max_distance_m = point.max_distance_m;
  for (std::size_t i = 0; i < kDescriptorBytes; ++i)
    message.descriptor[i] = static_cast<std::uint8_t>(point.descriptor[i / 8] >> (8 * (i % 8)));
  message.first_key_frame = point.first_key_frame;
  message.visible = point.visible;
  message.found = point.found;
  message.observations = to_message(point.observations);
  message.observation_count = count(message.observations);
  return message;
}

slam::MapPoint from_message(const map_point_t& message, const std::string& in) {
  const std::string where = in + ": point " + std::to_string(message.id);
  slam::MapPoint point;
  point.id = id(message.id, false, where, "id");
  point.position_world = finite(message.position_world_m, where, "its position");
  point.viewing_direction = finite(message.viewing_direction, where, "its viewing direction");
  point.min_distance_m = message.min_distance_m;
  point.max_distance_m = message.max_distance_m;
  if (!(point.min_distance_m >= 0.0) || !(point.max_distance_m >= point.min_distance_m) ||
      !std::isfinite(point.max_distance_m))
    fail(where, "its distances are impossible");
  point.descriptor = descriptor(message.descriptor);
  point.first_key_frame = id(message.first_key_frame, true, where, "first key frame");
  point.visible = message.visible;
  point.found = message.found;
  if (point.visible < 0 || point.found < 0) fail(where, "a negative count");
  point.observations = from_message(message.observations, where);
  return point;
}

map_plane_t to_message(const slam::MapPlane& plane) {
  map_plane_t message{};
  message.id = plane.id;
  copy(plane.normal_world, message.normal_world);
  message.distance_m = plane.distance_m;
  to_triangle(plane.covariance, message.covariance);
  message.sightings = plane.sightings;
  message.confirmed = plane.confirmed ? 1 : 0;
  message.cloud_world_m = to_coordinates(plane.cloud_world);
  message.coordinate_count = count(message.cloud_world_m);
  message.observations = to_message(plane.observations);
  message.observation_count = count(message.observations);
  return message;
}

slam::MapPlane from_message(const map_plane_t& message, const std::string& in) {
  const std::string where = in + ": plane " + std::to_string(message.id);
  slam::MapPlane plane;
  plane.id = id(message.id, false, where, "id");
  plane.normal_world = unit(message.normal_world, where, "its normal");
  plane.distance_m = message.distance_m;
  plane.covariance = from_triangle(message.covariance, where);
  plane.sightings = message.sightings;
  plane.confirmed = message.confirmed != 0;
  if (!std::isfinite(plane.distance_m) || plane.sightings < 0)
    fail(where, "its distance or sightings are impossible");
  plane.cloud_world = from_coordinates(message.cloud_world_m, where);
  plane.observations = from_message(message.observations, where);
  return plane;
}

}  // namespace

pose_t to_message(const slam::Rigid3d& pose) {
  pose_t message{};
  copy(pose.translation, message.translation);
  message.rotation[0] = pose.rotation.w();
  message.rotation[1] = pose.rotation.x();
  message.rotation[2] = pose.rotation.y();
  message.rotation[3] = pose.rotation.z();
  return message;
}

slam::Rigid3d from_message(const pose_t& message, const std::string& where) {
  slam::Rigid3d pose;
  pose.translation = finite(message.translation, where, "the translation");
  pose.rotation = Eigen::Quaterniond(message.rotation[0], message.rotation[1], message.rotation[2],
                                     message.rotation[3]);
  if (!(std::abs(pose.rotation.norm() - 1.0) <= 1e-6))
    fail(where, "the rotation's quaternion is not of unit length");
  return pose;
}

void to_message(const slam::TrackedFrame& tracked, std::int64_t tracker_session,
                std::int64_t map_id, camera_pose_t& message) {
  message.state = tracked.state == slam::TrackingState::kTracked ? camera_pose_t::TRACKED
                  : tracked.state == slam::TrackingState::kLost  ? camera_pose_t::LOST
                                                                 : camera_pose_t::NOT_STARTED;
  message.reason = tracked.reason;
  message.tracker_session = tracker_session;
  message.map_id = map_id;
  message.map_version = tracked.map_version;
  message.T_world_camera = to_message(tracked.T_camera_world.inverse());
  for (int i = 0; i < 36; ++i) message.covariance[i] = tracked.covariance(i / 6, i % 6);
  message.reference = tracked.reference;
  message.T_camera_reference = to_message(tracked.T_camera_reference);
  message.points = tracked.points;
  message.planes = tracked.planes;
  message.key_frame = tracked.key_frame ? 1 : 0;
}

PoseContent from_message(const camera_pose_t& message) {
  const std::string where = "CAMERA_POSE";
  PoseContent content;
  slam::TrackedFrame& tracked = content.tracked;
  switch (message.state) {
    case camera_pose_t::NOT_STARTED:
      tracked.state = slam::TrackingState::kNotStarted;
      break;
    case camera_pose_t::TRACKED:
      tracked.state = slam::TrackingState::kTracked;
      break;
    case camera_pose_t::LOST:
      tracked.state = slam::TrackingState::kLost;
      break;
    default:
      fail(where, "unknown state " + std::to_string(message.state));
  }
  tracked.frame = message.header.seq;
  tracked.utime = message.header.utime;
  tracked.reason = message.reason;
  content.tracker_session = message.tracker_session;
  content.map_id = message.map_id;
  tracked.map_version = version(message.map_version, where, "map_version");
  tracked.T_camera_world =
      from_message(message.T_world_camera, where + ": T_world_camera").inverse();
  for (int i = 0; i < 36; ++i) tracked.covariance(i / 6, i % 6) = message.covariance[i];
  if (!tracked.covariance.allFinite() || !(tracked.covariance.diagonal().array() >= 0.0).all())
    fail(where, "the covariance is not finite or has a negative variance");
  tracked.reference = id(message.reference, true, where, "reference");
  tracked.T_camera_reference =
      from_message(message.T_camera_reference, where + ": T_camera_reference");
  tracked.points = message.points;
  tracked.planes = message.planes;
  if (tracked.points < 0 || tracked.planes < 0) fail(where, "a negative count");
  content.key_frame = message.key_frame != 0;
  return content;
}

void to_message(const slam::NewKeyFrame* key_frame, std::int64_t tracker_session,
                const MapState& map, keyframe_t& message) {
  message.tracker_session = tracker_session;
  message.map_id = map.map_id;
  message.map_version = map.version;
  message.is_key_frame = key_frame ? 1 : 0;
  const slam::NewKeyFrame none;
  const slam::NewKeyFrame& from = key_frame ? *key_frame : none;
  message.camera_model = to_message(from.input.camera);
  message.T_camera_world = to_message(from.T_camera_world);
  message.pose_version = from.map_version;
  message.reference = from.reference;
  message.new_plane = from.new_plane ? 1 : 0;
  message.by_planes = from.by_planes ? 1 : 0;
  message.features = to_message(from.input.features);
  message.points = from.points;
  message.point_count = count(message.points);
  message.planes.clear();
  for (const auto& segment : from.input.planes) message.planes.push_back(to_message(segment));
  message.plane_count = count(message.planes);
  message.plane_ids = from.planes;
  message.seen_points = to_message(from.seen_points);
  message.seen_planes = to_message(from.seen_planes);
}

KeyFrameContent from_message(const keyframe_t& message) {
  const std::string where = "KEYFRAME";
  KeyFrameContent content;
  content.tracker_session = message.tracker_session;
  content.map.map_id = message.map_id;
  content.map.version = version(message.map_version, where, "map_version");
  if (message.is_key_frame == 0) return content;
  slam::NewKeyFrame& key_frame = content.key_frame.emplace();
  key_frame.input.frame = message.header.seq;
  key_frame.input.utime = message.header.utime;
  key_frame.input.camera = from_message(message.camera_model, where);
  key_frame.T_camera_world = from_message(message.T_camera_world, where);
  key_frame.map_version = version(message.pose_version, where, "pose_version");
  key_frame.reference = id(message.reference, true, where, "reference");
  key_frame.new_plane = message.new_plane != 0;
  key_frame.by_planes = message.by_planes != 0;
  key_frame.input.features = from_message(message.features, where);
  key_frame.points = ids(message.points, true, where, "point");
  if (key_frame.points.size() != key_frame.input.features.size())
    fail(where, std::to_string(key_frame.points.size()) + " points for " +
                    std::to_string(key_frame.input.features.size()) + " features");
  for (const auto& segment : message.planes)
    key_frame.input.planes.push_back(
        from_message(segment, where + ": plane " + std::to_string(key_frame.input.planes.size())));
  key_frame.planes = ids(message.plane_ids, true, where, "plane");
  key_frame.seen_points = from_message(message.seen_points, where);
  key_frame.seen_planes = from_message(message.seen_planes, where);
  return content;
}

map_content_t content_of(const slam::MapUpdate& update) {
  map_content_t content{};
  for (const auto& each : update.new_key_frames) content.new_key_frames.push_back(to_message(each));
  for (const auto& each : update.key_frames) content.changes.push_back(to_message(each));
  for (const auto& each : update.points) content.points.push_back(to_message(each));
  for (const auto& each : update.planes) content.planes.push_back(to_message(each));
  content.removed_key_frames = update.removed_key_frames;
  content.removed_points = update.removed_points;
  content.removed_planes = update.removed_planes;
  content.new_key_frame_count = count(content.new_key_frames);
  content.change_count = count(content.changes);
  content.point_count = count(content.points);
  content.plane_count = count(content.planes);
  content.removed_key_frame_count = count(content.removed_key_frames);
  content.removed_point_count = count(content.removed_points);
  content.removed_plane_count = count(content.removed_planes);
  return content;
}

void from_message(const map_content_t& message, slam::MapUpdate& update, const std::string& where) {
  for (const auto& each : message.new_key_frames)
    update.new_key_frames.push_back(from_message(each, where));
  for (const auto& each : message.changes) {
    const std::string place = where + ": change of key frame " + std::to_string(each.id);
    update.key_frames.push_back({id(each.id, false, place, "id"),
                                 from_message(each.T_camera_world, place), each.keep != 0,
                                 id(each.parent, true, place, "parent"),
                                 ids(each.loop_partners, false, place, "loop partner")});
  }
  for (const auto& each : message.points) update.points.push_back(from_message(each, where));
  for (const auto& each : message.planes) update.planes.push_back(from_message(each, where));
  update.removed_key_frames = ids(message.removed_key_frames, false, where, "removed key frame");
  update.removed_points = ids(message.removed_points, false, where, "removed point");
  update.removed_planes = ids(message.removed_planes, false, where, "removed plane");
}

void to_message(const slam::MapUpdate& update, std::int64_t map_id, const slam::Map& map,
                map_update_t& message) {
  message.map_id = map_id;
  message.from_version = update.from_version;
  message.to_version = update.to_version;
  message.frame = update.frame;
  message.key_frame_count = static_cast<std::int32_t>(map.key_frames.size());
  message.point_count = static_cast<std::int32_t>(map.points.size());
  message.plane_count = static_cast<std::int32_t>(map.planes.size());
  message.part_index = 0;
  message.part_count = 1;
  const map_content_t content = content_of(update);
  message.data.resize(static_cast<std::size_t>(content.getEncodedSize()));
  message.data_size = count(message.data);
  content.encode(message.data.data(), 0, message.data_size);
}

slam::MapUpdate from_message(const map_update_t& message) {
  const std::string where = "MAP_UPDATE";
  if (message.part_count != 1 || message.part_index != 0)
    fail(where, "part " + std::to_string(message.part_index) + " of " +
                    std::to_string(message.part_count) + " is not a whole update");
  slam::MapUpdate update;
  update.from_version = version(message.from_version, where, "from_version");
  update.to_version = version(message.to_version, where, "to_version");
  update.frame = message.frame;
  if (update.from_version > update.to_version)
    fail(where, "it goes back from version " + std::to_string(update.from_version) + " to " +
                    std::to_string(update.to_version));
  map_content_t content{};
  const int size = static_cast<int>(message.data.size());
  int decoded = -1;
  try {
    decoded = content.decode(message.data.data(), 0, size);
  } catch (const std::exception&) {
    // lcm-gen's decoders throw on a string of length 0; the same as bytes that do not decode.
  }
  if (decoded != size) fail(where, std::to_string(size) + " bytes of data are no map_content_t");
  from_message(content, update, where);
  return update;
}

}  // namespace weft::messages
