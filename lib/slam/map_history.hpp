#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <utility>

#include "slam/map.hpp"

/// Updates between any two versions, for readers that may miss some.
namespace weft::slam {

/// When each entity of a map last changed, so that the changes since any version can be told.
class MapHistory {
 public:
  /// max_removed: of each kind, how many removed entities are remembered; who is further behind
  /// gets the whole map.
  explicit MapHistory(std::size_t max_removed = 50'000) : max_removed_(max_removed) {}

  /// Forgets everything; the map is at `version` now.
  void begin(std::int64_t version);
  /// Takes note of an update that was made to the map. Throws Error when it does not follow the
  /// last one.
  void add(const MapUpdate& update);

  /// What brings a copy at `version` to `map`, which all updates are in: the whole map when the
  /// version is 0, none of this history or too long ago. frame: the last that is in the map.
  MapUpdate since(std::int64_t version, const Map& map, std::int64_t frame) const;

 private:
  struct Removed {
    std::deque<std::pair<std::int64_t, Id>> by_version;
  };
  void note(Removed& removed, std::int64_t version, const std::vector<Id>& ids);
  std::size_t max_removed_;
  std::int64_t first_ = 0;  // changes are known since this version
  std::int64_t version_ = 0;
  std::map<Id, std::int64_t> added_, changed_, points_, planes_;  // the version they came with
  Removed removed_key_frames_, removed_points_, removed_planes_;
};

/// The same update for a copy that has part of it already (from_version <= copy.version): goes on
/// from the copy's version, and names no key frame that came and went in between.
MapUpdate continued_from(MapUpdate update, const Map& copy);

}  // namespace weft::slam
