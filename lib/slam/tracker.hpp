#pragma once

#include <memory>

#include "slam/absolute_orientation.hpp"
#include "slam/plane_matching.hpp"
#include "slam/pose_optimiser.hpp"
#include "slam/sensor_noise.hpp"
#include "slam/tracking.hpp"
#include "slam/vocabulary.hpp"

namespace weft::slam {

struct TrackerOptions {
  bool use_planes = true;
  int points_to_start = 500;
  int planes_to_start = 3;
  int points_to_start_with_planes = 50;
  double motion_max_s = 0.15;
  double wide_ratio = 0.85;
  int local_key_frames = 40;
  int points_to_track = 30;
  int points_to_relocalise = 50;
  double max_sigma_m = 0.05;
  double max_sigma_deg = 2.0;
  double key_frame_interval_s = 1.0;
  double key_frame_share = 0.75;
  double close_m = 3.1;
  double new_plane_s = 0.2;
  int new_plane_cells = 8;
  int max_pending = 8;
  int levels = 8;
  SensorNoise noise;
  PlaneMatchOptions plane_match;
  PoseOptions pose;
  RansacOptions ransac{.min_points = 3};  // what was found is judged by points_to_track

  void visit(OptionVisitor& v) {
    v.field("use_planes", use_planes, "track by planes as well as by points");
    v.field("points_to_start", points_to_start, {20, 10000}, "",
            "more features with depth than these start a map; ORB-SLAM2, and garment-slam.txt "
            "3.5.3");
    v.field("planes_to_start", planes_to_start, {1, 100}, "",
            "so many planes start one as well ...");
    v.field("points_to_start_with_planes", points_to_start_with_planes, {0, 10000}, "",
            "... with so many features (garment-slam.txt 3.5.3)");
    v.field("motion_max_s", motion_max_s, {0.0, 10.0}, "s",
            "between frames, up to which features are looked for where steady motion takes them; "
            "else, and where that fails, all over the picture");
    v.field("wide_ratio", wide_ratio, {0.1, 1.0}, "",
            "of the distances of the best and the second best feature, there");
    v.field("local_key_frames", local_key_frames, {1, 1000}, "",
            "whose points are looked for; ORB-SLAM2: 80");
    v.field(
        "points_to_track", points_to_track, {6, 1000}, "",
        "map points that must agree with a pose (ORB-SLAM2: 30); a third of that where planes that "
        "agree face two ways, a fifth where they face three");
    v.field("points_to_relocalise", points_to_relocalise, {6, 1000}, "",
            "likewise after having been lost and for a second then; ORB-SLAM2: 50");
    v.field("max_sigma_m", max_sigma_m, {1e-3, 10.0}, "m",
            "a pose known less well than this, in any direction, is lost");
    v.field("max_sigma_deg", max_sigma_deg, {0.01, 90.0}, "deg", "likewise its rotation");
    v.field("key_frame_interval_s", key_frame_interval_s, {0.0, 60.0}, "s",
            "from one key frame to the next, unless the mapper has nothing to do or few points are "
            "left; ORB-SLAM2: 1 s");
    v.field("key_frame_share", key_frame_share, {0.0, 1.0}, "",
            "a key frame is made when less than this share of its reference's points is seen; "
            "ORB-SLAM2: 0.75");
    v.field("close_m", close_m, {0.1, 100.0}, "m",
            "nearer points tell translation well: a key frame is made when few of these are "
            "tracked and many could be; ORB-SLAM2: 40 baselines");
    v.field("new_plane_s", new_plane_s, {0.0, 10.0}, "s",
            "that a plane the map has not is seen before it makes a key frame (garment-slam.txt "
            "3.5.2: 0.2 of a second's frames)");
    v.field("new_plane_cells", new_plane_cells, {1, 10000}, "",
            "that its segment has at least (PlaneSegment::cells)");
    v.field("max_pending", max_pending, {1, 100}, "",
            "key frames that wait for the mapper at most; no further ones are made until it "
            "answers");
    v.field("levels", levels, {1, 12}, "", "of the features' pyramid: FeatureOptions::levels");
    v.group("noise", noise);
    v.group("plane_match", plane_match);
    v.group("pose", pose);
    v.group("ransac", ransac);
  }
  void validate() const { validate_fields(*this, "TrackerOptions"); }
};

/// Where the camera is, frame by frame, in the map its copy of which updates keep: the tracking of
/// ORB-SLAM2 (Mur-Artal and Tardos, T-RO 2017) with planes as features (garment-slam.txt 3.5), also
/// of frames that lie far apart. A pure function of the updates and frames given, in their order.
///
/// It asks for key frames (TrackedFrame::key_frame) and goes on tracking by them while the mapper
/// has not answered, so the answer may come any number of frames later. The first one starts the
/// map: its camera is the world's frame.
///
/// It says kLost rather than guess: too few points and planes agree with any pose it can find, or
/// those that do leave a direction undetermined. Lost, it looks for itself near where it was and,
/// by the vocabulary, in the whole map.
class Tracker {
 public:
  /// vocabulary: finds places again; nullptr: only the last and nearby ones. Throws Error.
  Tracker(const TrackerOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary);
  ~Tracker();
  Tracker(Tracker&&) noexcept;
  Tracker& operator=(Tracker&&) noexcept;

  /// Takes over what the mapper changed. An update that is in the copy already (a repetition)
  /// changes nothing. Throws Error, and changes nothing, when it does not follow the copy's
  /// version: ask for the whole map then. An empty whole map (to_version 0) says that the mapper
  /// began anew: so does the tracker.
  void update(const MapUpdate& update);

  /// Throws Error on a frame that cannot be: not after the last one, values that are not finite.
  TrackedFrame track(const FrameInput& input);

  const Map& map() const;

  /// As constructed: no map, nothing pending.
  void reset();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace weft::slam
