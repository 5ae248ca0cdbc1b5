#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slam/map.hpp"

/// What goes into tracking, and what it says of a frame.
namespace weft::slam {

/// A frame as tracking and mapping see it: no images.
struct FrameInput {
  std::int64_t frame = 0;  // counts up; gaps are frames that never came
  std::int64_t utime = 0;  // us, of the measurement
  rgbd::CameraModel camera;
  std::vector<Feature> features;
  std::vector<plane::PlaneSegment> planes;
};

enum class TrackingState {
  kNotStarted,  // too little to see to start a map with
  kTracked,
  kLost,  // the pose is not known; nothing is guessed
};

/// How often a landmark was looked for and seen since the last key frame.
struct Sightings {
  Id id = kNoId;
  int visible = 0;
  int found = 0;
};

/// What the mapper needs of a frame that shall become part of the map.
struct NewKeyFrame {
  FrameInput input;
  Rigid3d T_camera_world;        // as tracked in the map of map_version
  std::int64_t map_version = 0;  // 0: starts a map
  Id reference = kNoId;          // the key frame most of its points are in; kNoId: none yet
  std::vector<Id> points;        // one a feature: the map point seen, or kNoId
  std::vector<Id> planes;        // one a segment, likewise
  bool new_plane = false;        // a reason for it: a plane the map has not
  bool by_planes = false;        // few points: planes carry the pose
  std::vector<Sightings> seen_points, seen_planes;  // since the last key frame, by id
};

struct TrackedFrame {
  std::int64_t frame = 0;
  std::int64_t utime = 0;
  TrackingState state = TrackingState::kNotStarted;
  std::string reason;      // why it is lost or not started; how it was found again
  Rigid3d T_camera_world;  // meaningful when tracked
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  // ^ of (rotation [rad], translation [m]) in the camera frame, as optimise_pose gives it
  std::int64_t map_version = 0;          // of the map it is a pose in
  Id reference = kNoId;                  // key frame that most of its points are in
  Rigid3d T_camera_reference;            // follows the map when that is corrected later
  int points = 0;                        // map points seen that agree with the pose
  int planes = 0;                        // planes likewise
  std::optional<NewKeyFrame> key_frame;  // set when it shall be one
};

}  // namespace weft::slam
