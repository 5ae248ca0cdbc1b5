#pragma once

#include <vector>

#include "slam/anchored_pose.hpp"
#include "slam/tracking.hpp"

namespace weft::slam {

/// All poses of a run, held by key frames: as the map corrects those, it corrects the path.
class CameraPath {
 public:
  /// map: that the frame was tracked in. Frames that were not tracked are left out.
  void add(const TrackedFrame& frame, const Map& map);
  /// To be called before the update is applied to the map.
  void follow(const MapUpdate& update, const Map& before);

  struct Pose {
    std::int64_t frame = 0, utime = 0;
    Rigid3d T_camera_world;
  };
  /// As the map has them now.
  std::vector<Pose> poses(const Map& map) const;
  /// As they were said when they were tracked.
  const std::vector<Pose>& live() const { return live_; }

 private:
  std::vector<Pose> live_;
  std::vector<AnchoredPose> anchors_;  // likewise
};

}  // namespace weft::slam
