#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "dataset/trajectory_file.hpp"
#include "slam/anchored_pose.hpp"
#include "slam/garment_map.hpp"
#include "slam/map.hpp"
#include "slam/tracking.hpp"

/// The map and the camera's path as a log of CAMERA_POSE and MAP_UPDATE has them.
namespace weft::mapping {

/// What was said of one frame.
struct LoggedPose {
  slam::TrackedFrame tracked;  // its key_frame is not set
  std::int64_t map_id = 0;     // of the map it is a pose in
  slam::AnchoredPose anchor;   // in the log's last map; of poses in that one
};

struct MapLog {
  std::vector<LoggedPose> poses;        // in the log's order, one a frame that was answered
  slam::Map map;                        // the last version
  std::vector<slam::Garment> garments;  // as the last MAP_OBJECTS has them, candidates too
  std::int64_t map_id = 0;              // 0: the log has none
  std::vector<std::int64_t> map_ids;    // of all maps in the log, in order
  std::int64_t frames = 0;              // RGBD_FRAMEs, or answers where the log has none

  /// Poses in the last map, of tracked frames: as they were said, or as the key frames that hold
  /// them have been moved since.
  dataset::Trajectory path(bool corrected) const;
};

/// Reads one camera's run. suffix: "@mine" reads a variant's CAMERA_POSE@mine, MAP_UPDATE@mine and
/// MAP_OBJECTS@mine.
/// Throws Error when the log cannot be read, holds several cameras' poses or neither channel, or
/// its updates do not follow each other.
MapLog read_map_log(const std::string& path, const std::string& suffix = "");

}  // namespace weft::mapping
