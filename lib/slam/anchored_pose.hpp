#pragma once

#include "slam/map.hpp"

namespace weft::slam {

/// A camera's pose held by a key frame, so that it follows when the map is corrected.
struct AnchoredPose {
  Id reference = kNoId;        // kNoId: held by the world itself
  Rigid3d T_camera_reference;  // or T_camera_world

  /// Holds a pose by a key frame of the map, or by the world where that one is not there.
  static AnchoredPose at(const Rigid3d& T_camera_world, const Map& map, Id reference);

  /// Throws Error when the reference is not in the map.
  Rigid3d T_camera_world(const Map& map) const;

  /// To be called before the update is applied to the map: where it takes the reference away, the
  /// nearest of its ancestors that stays takes over, or else the world.
  void follow(const MapUpdate& update, const Map& before);
};

}  // namespace weft::slam
