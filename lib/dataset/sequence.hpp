#pragma once

#include <memory>
#include <string>
#include <vector>

#include "dataset/trajectory_file.hpp"
#include "rgbd/frame.hpp"

/// Recordings of a moving RGB-D camera.
namespace weft::dataset {

struct SequenceFrame {
  std::int64_t utime = 0;     // of the colour image
  std::string colour, depth;  // paths
};

/// A recording in a folder. Its files' names and times are known, its images are read one by one.
struct Sequence {
  std::string kind;  // "tum", "cube_slam", "7scenes", "icl"
  std::string name;  // the folder's
  rgbd::CameraModel camera;
  double depth_unit_m = 0.001;
  std::vector<SequenceFrame> frames;  // by time
  Trajectory truth;                   // empty when the folder has none; need not have every frame

  /// Throws Error naming the file and the reason.
  rgbd::RgbdFrame read(std::size_t index) const;
};

/// Tells the kind of a folder from its files:
///   tum        rgb.txt and depth.txt with times, as the TUM RGB-D benchmark and `weft synth
///              sequences` write them; images closest in time belong together (associations.txt
///              instead where there is one). groundtruth.txt. camera.yaml (width, height, fx, fy,
///              cx, cy, depth_factor) or, where there is none, the benchmark's camera: that of
///              freiburg1, 2 or 3 if the folder's name says so, else 525 px
///   cube_slam  rgb/N.jpg, depth/N.png, truth_cam_poses.txt, TUM3.yaml (Yang and Scherer's key
///              frames of TUM fr3/cabinet); a frame's time is that of the truth's line N
///   7scenes    frame-N.color.jpg (or .png), frame-N.depth.png, frame-N.pose.txt,
///              camera-intrinsics.txt where there is one, else 585 px; 30 frames a second by N
///   icl        image/N.jpg (or rgb/), depth/N.png, groundtruth_keyframes_relative_to_frame0.txt;
///              525 px; 30 frames a second by N
/// Throws Error that says what was looked for when it is none of these, and when files that belong
/// together are not all there.
Sequence open_sequence(const std::string& folder);

/// The kind open_sequence would take the folder for; empty when it is no recording.
std::string sequence_kind(const std::string& folder);

}  // namespace weft::dataset
