#pragma once

#include <map>
#include <set>

#include "slam/map.hpp"

namespace weft::slam {

/// The ids the next landmarks of each kind get.
struct NextIds {
  Id key_frame = 0;
  Id point = 0;
  Id plane = 0;
  bool operator==(const NextIds&) const = default;
};

/// The one way a map is changed: key frames and landmarks always agree about who sees what, and
/// what changed is remembered for the next update. All functions throw Error on ids that are not
/// there and indices out of range, and change nothing then.
class MapEditor {
 public:
  MapEditor() = default;
  /// Goes on with a map. Throws Error when an id is not below the next one.
  MapEditor(Map map, const NextIds& next);

  const Map& map() const { return map_; }
  const NextIds& next_ids() const { return next_; }
  const KeyFrame& key_frame(Id id) const;
  const MapPoint& point(Id id) const;
  const MapPlane& plane(Id id) const;

  /// The id is given here; the lists of what it sees start empty: observe() fills them.
  Id add_key_frame(KeyFrame key_frame);
  void set_pose(Id key_frame, const Rigid3d& T_camera_world);
  void set_keep(Id key_frame, bool keep);
  void set_parent(Id key_frame, Id parent);
  void tie(Id key_frame_a, Id key_frame_b);  // loop partners
  /// Nothing sees it any longer; its children go to its parent.
  void remove_key_frame(Id id);

  Id add_point(const Eigen::Vector3d& position_world, Id first_key_frame);
  /// To be changed but for its id and observations; it goes into the update.
  MapPoint& edit_point(Id id);
  /// The point's counters, which do not go into updates.
  void count(Id point, int visible, int found);
  /// A key frame sees a point at one feature at most, a feature is of one point at most: Error.
  void observe_point(Id point, Id key_frame, int feature);
  void unobserve_point(Id point, Id key_frame);
  void remove_point(Id id);
  /// `by` takes over what it does not see itself and the counters; `point` goes.
  void replace_point(Id point, Id by);

  Id add_plane(const Eigen::Vector3d& normal_world, double distance_m);
  MapPlane& edit_plane(Id id);
  void observe_plane(Id plane, Id key_frame, int segment);
  void unobserve_plane(Id plane, Id key_frame, int segment);
  void remove_plane(Id id);
  /// `by` takes over the sightings and the cloud; `plane` goes.
  void replace_plane(Id plane, Id by);

  bool has_changes() const;
  /// All changes since the last call, as one version. `frame`: the last that is in them.
  MapUpdate take_update(std::int64_t frame);

  /// The landmark that took over from one that went within the last kRemembered versions, or the
  /// one itself; kNoId when there is none.
  Id present_point(Id id) const;
  /// Where a key frame was in an earlier version, or is. False when it is not known any longer.
  bool pose_at(Id key_frame, std::int64_t version, Rigid3d& T_camera_world) const;
  static constexpr std::int64_t kRemembered = 64;

 private:
  KeyFrame& find_key_frame(Id id);
  MapPoint& find_point(Id id);
  MapPlane& find_plane(Id id);
  void remember_pose(const KeyFrame& key_frame);

  Map map_;
  NextIds next_;
  std::set<Id> new_key_frames_, changed_key_frames_, changed_points_, changed_planes_;
  std::set<Id> removed_key_frames_, removed_points_, removed_planes_;
  struct Past {  // of the version that ended it
    std::map<Id, Rigid3d> poses;
    std::map<Id, Id> points_replaced;
  };
  std::map<std::int64_t, Past> past_;
};

}  // namespace weft::slam
