#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "slam/anchored_pose.hpp"
#include "slam/local_map.hpp"
#include "slam/place_index.hpp"
#include "slam/plane_matching.hpp"
#include "slam/tracking.hpp"

namespace weft::slam {

/// A frame with its pose and the landmarks recognised in it.
struct PlacedFrame {
  FrameInput input;
  AnchoredPose anchor;
  Rigid3d T_camera_world;          // what the anchor says in the map as it is
  std::vector<Id> points, planes;  // one a feature or segment
};

/// The map as a tracker sees it: its copy, and the key frames the mapper has not answered yet. What
/// such a key frame shows and the map has not is a landmark all the same, with an id below kNoId
/// that turns into the map's when the key frame arrives there.
class MapCopy {
 public:
  /// vocabulary: may be nullptr.
  MapCopy(std::shared_ptr<const BinaryVocabulary> vocabulary, const Pyramid& pyramid);

  const Map& map() const { return map_; }
  /// Of the map's key frames; nullptr without a vocabulary.
  const PlaceIndex* places() const { return places_ ? &*places_ : nullptr; }
  bool empty() const { return map_.key_frames.empty() && pending_.empty(); }

  /// See Tracker::update. `held`: frames whose landmarks and poses are to be brought along.
  void update(const MapUpdate& update, std::vector<PlacedFrame*> held);

  /// Adds a key frame that waits for the mapper. Gives ids to its features with depth and its
  /// segments that had none.
  void wait_for(PlacedFrame& key_frame);
  int waiting() const { return static_cast<int>(pending_.size()); }
  /// Oldest first.
  const PlacedFrame& waiting(int index) const {
    return pending_[static_cast<std::size_t>(index)].frame;
  }

  /// nullopt: it is (no longer) there.
  std::optional<LocalPoint> point(Id id) const;
  std::optional<KnownPlane> plane(Id id) const;
  /// All of the map's, then those that wait.
  std::vector<std::pair<Id, KnownPlane>> planes() const;
  /// All points that wait for the map.
  std::vector<LocalPoint> waiting_points() const;

 private:
  struct Pending {
    PlacedFrame frame;
    std::int64_t number = 0;
    // What is new in it, by index of the feature or segment.
    std::map<std::size_t, LocalPoint> points;
    std::map<std::size_t, KnownPlane> planes;
  };
  void place(Pending& pending) const;
  const Pending* pending(Id id) const;

  std::shared_ptr<const BinaryVocabulary> vocabulary_;
  Pyramid pyramid_;
  Map map_;
  std::optional<PlaceIndex> places_;
  std::vector<Pending> pending_;  // oldest first
  std::int64_t next_number_ = 0;
};

}  // namespace weft::slam
