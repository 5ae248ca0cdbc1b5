#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "base/options.hpp"
#include "slam/map_editor.hpp"
#include "slam/plane_matching.hpp"
#include "slam/tracking.hpp"

/// The planes of a map: which segment is which plane, when a plane is believed, which planes are
/// one. After garment-slam.txt 3.4, 3.5.2 and 3.5.3.
namespace weft::slam {

struct PlaneMappingOptions {
  PlaneMatchOptions match;
  double voxel_m = 0.05;
  double max_gap_m = 0.5;
  double confirm_s = 0.2;
  int confirm_sightings = 3;
  int give_up_key_frames = 10;
  double same_frame_tilt_deg = 1.0;
  double same_frame_distance_m = 0.004;

  void visit(OptionVisitor& v) {
    v.group("match", match);
    v.field("voxel_m", voxel_m, {0.005, 1.0}, "m",
            "a plane's cloud has one point in a cube of this side (garment-slam.txt 3.5.2: 0.05)");
    v.field("max_gap_m", max_gap_m, {0.01, 100.0}, "m",
            "a segment that is farther than this from all of a plane's points is not that plane, "
            "nor are two planes of the map one: tables of the same height are two");
    v.field("confirm_s", confirm_s, {0.0, 10.0}, "s",
            "a plane is believed when it was seen in as many frames as come in this time "
            "(garment-slam.txt 3.5.2: 0.2 x frames per second) ...");
    v.field("confirm_sightings", confirm_sightings, {1, 1000}, "",
            "... and in so many: what sparse sequences go by");
    v.field("give_up_key_frames", give_up_key_frames, {1, 1000}, "",
            "a plane that is not believed so many key frames after it came goes");
    v.field("same_frame_tilt_deg", same_frame_tilt_deg, {0.0, 10.0}, "deg",
            "floor of the tilt between two segments of one picture that are one plane ...");
    v.field(
        "same_frame_distance_m", same_frame_distance_m, {0.0, 0.1}, "m",
        "... and of their distance at 1 m, growing with the depth squared: less than the "
        "sensor's own, whose warps two surfaces side by side share. What differs by more is two "
        "planes: cloth folded on a table");
  }
  void validate() const { validate_fields(*this, "PlaneMappingOptions"); }
};

class PlaneMapper {
 public:
  explicit PlaneMapper(const PlaneMappingOptions& options);

  /// Says for each plane segment of the key frame which plane of the map it is: the assignment of
  /// least total chi-squared distance to the planes near it, then further segments in one plane
  /// with one beside them that was assigned; what is left becomes new planes. Returns whether there
  /// are new ones. pose_covariance: of the key frame's pose.
  bool associate(MapEditor& editor, Id key_frame, const Matrix6d& pose_covariance) const;
  /// Adds sightings in the frames since the last key frame, believes planes seen often enough,
  /// removes those that are not. frame_s: time from frame to frame.
  void judge(MapEditor& editor, Id key_frame, std::span<const Sightings> seen,
             double frame_s) const;
  /// Makes one plane of those that cannot be told apart and lie side by side. Returns how many
  /// went.
  int merge(MapEditor& editor) const;
  /// State and covariance from all sightings, at the key frames' poses: for planes that take no
  /// part in the bundle adjustment.
  void estimate(MapEditor& editor, Id plane) const;
  /// The cloud anew from all sightings: where key frames have moved.
  void rebuild_cloud(MapEditor& editor, Id plane) const;

 private:
  void add_sighting(MapEditor& editor, Id plane, Id key_frame, int segment) const;
  bool are_one(const plane::PlaneSegment& a, const plane::PlaneSegment& b) const;
  bool seen_apart(const Map& map, const MapPlane& a, const MapPlane& b) const;

  PlaneMappingOptions options_;
};

}  // namespace weft::slam
