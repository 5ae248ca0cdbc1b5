#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "slam/garment_map.hpp"
#include "weft/map_objects_t.hpp"

/// MAP_OBJECTS to and from lib/slam's garments.
namespace weft::messages {

struct MapObjectsContent {
  std::int64_t map_id = 0;
  std::int64_t map_version = 0;
  std::optional<slam::Rigid3d> T_base_world;  // for this frame
  std::vector<slam::Garment> garments;        // without anchors: these are the sender's own
};

/// Fills in everything but header and status.
void to_message(const MapObjectsContent& content, map_objects_t& message);

/// Throws stage::InvalidInput, naming the garment, for content no sender of ours makes: numbers
/// that are not finite, covariances with a negative variance, directions not of unit length,
/// probabilities outside 0 to 1, ids or counts below 0, ids that do not ascend.
MapObjectsContent from_message(const map_objects_t& message);

}  // namespace weft::messages
