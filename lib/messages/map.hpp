#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "slam/tracking.hpp"
#include "weft/camera_pose_t.hpp"
#include "weft/keyframe_t.hpp"
#include "weft/map_content_t.hpp"
#include "weft/map_update_t.hpp"
#include "weft/pose_t.hpp"

/// CAMERA_POSE, KEYFRAME and MAP_UPDATE to and from lib/slam's types: every number comes back as it
/// was, to the bit. from_message throws stage::InvalidInput, naming the field, for content no
/// sender of ours makes.
namespace weft::messages {

/// What a tracker's copy of the map is at.
struct MapState {
  std::int64_t map_id = 0;   // 0: no map
  std::int64_t version = 0;  // 0: empty
};

pose_t to_message(const slam::Rigid3d& pose);
/// The quaternion must be of unit length within 1e-6; it is not normalised.
slam::Rigid3d from_message(const pose_t& message, const std::string& where);

struct PoseContent {
  slam::TrackedFrame tracked;  // its key_frame is not set
  std::int64_t tracker_session = 0;
  std::int64_t map_id = 0;
  bool key_frame = false;
};

/// Fills in everything but header and status.
void to_message(const slam::TrackedFrame& tracked, std::int64_t tracker_session,
                std::int64_t map_id, camera_pose_t& message);
PoseContent from_message(const camera_pose_t& message);

struct KeyFrameContent {
  std::int64_t tracker_session = 0;
  MapState map;
  std::optional<slam::NewKeyFrame> key_frame;
};

/// Fills in everything but header and status. key_frame: nullptr for "not one".
void to_message(const slam::NewKeyFrame* key_frame, std::int64_t tracker_session,
                const MapState& map, keyframe_t& message);
KeyFrameContent from_message(const keyframe_t& message);

/// Fills in everything but header and status. size: of the whole map at update.to_version.
void to_message(const slam::MapUpdate& update, std::int64_t map_id, const slam::Map& map,
                map_update_t& message);
/// Whether the update fits a map is for slam::apply to see.
slam::MapUpdate from_message(const map_update_t& message);

/// The map's entities as they are written to a file, too.
map_content_t content_of(const slam::MapUpdate& update);
/// Fills in the entities of the update.
void from_message(const map_content_t& message, slam::MapUpdate& update, const std::string& where);

}  // namespace weft::messages
