#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/weft/player.hpp"
#include "weft/camera_pose_t.hpp"
#include "weft/foreground_t.hpp"
#include "weft/grasps_t.hpp"
#include "weft/part_detections_t.hpp"
#include "weft/planes_t.hpp"
#include "weft/probability_map_t.hpp"
#include "weft/rgbd_frame_t.hpp"

namespace weft {

/// What the messages about one frame say, found by their types: channels may be mapped. Content
/// that contradicts itself is left out, and said in `problems`.
struct FrameContent {
  std::optional<weft::rgbd_frame_t> rgbd;  // parts joined
  std::optional<weft::foreground_t> foreground;
  std::optional<weft::probability_map_t> maps;
  std::optional<weft::part_detections_t> detections;
  std::optional<weft::grasps_t> grasps;
  std::optional<weft::planes_t> planes;
  std::optional<weft::camera_pose_t> pose;
  std::vector<std::string> problems;  // channels that are not OK or NOTHING, and why
  bool failed = false;                // some channel says FAILED, DROPPED or MISSING_INPUT
};

FrameContent read_content(const PlayedFrame& frame);

}  // namespace weft
