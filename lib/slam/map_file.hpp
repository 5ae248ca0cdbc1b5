#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "slam/garment_map.hpp"
#include "slam/map_editor.hpp"

namespace weft::slam {

/// What a mapper needs to go on with a map, and the garments in it.
struct SavedMap {
  Map map;
  NextIds next;
  std::vector<Id> young_points;  // not yet proven, see PointMapper
  std::int64_t frame = -1;       // the last in the map; -1: none, or of a session that has ended
  std::int64_t utime = 0;        // us, of that frame
  SavedGarments garments;        // a mapper knows none: its owner's
};

/// A map as a file (base/blob.hpp): versioned, with a checksum. The same bytes for the same map.
/// Throws Error when it is larger than a file that can be read again, 256 MiB.
std::vector<std::uint8_t> format_map(const SavedMap& saved);
void write_map(const std::string& path, const SavedMap& saved);

/// Throws Error, with the name and the reason, on anything that cannot be: damaged files, numbers
/// out of range, landmarks and key frames that do not agree.
SavedMap parse_map(std::span<const std::uint8_t> bytes, const std::string& name);
SavedMap read_map(const std::string& path);

}  // namespace weft::slam
