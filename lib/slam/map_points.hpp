#pragma once

#include <span>
#include <vector>

#include "base/options.hpp"
#include "slam/map_editor.hpp"
#include "slam/matching.hpp"
#include "slam/sensor_noise.hpp"

/// The points of a map: where they come from, how they are found again, when they go. After
/// ORB-SLAM2 (Mur-Artal and Tardos, T-RO 2017).
namespace weft::slam {

struct PointMappingOptions {
  double close_m = 3.1;
  int min_points = 100;
  int levels = 8;
  double search_radius_px = 3.0;
  int max_hamming = 50;
  double min_parallax_deg = 1.15;
  double min_found_share = 0.25;
  SensorNoise noise;

  void visit(OptionVisitor& v) {
    v.field("close_m", close_m, {0.1, 100.0}, "m",
            "depths up to this are good enough to make a point of at once: 40 baselines of a "
            "Kinect (ORB-SLAM2)");
    v.field("min_points", min_points, {0, 10000}, "",
            "so many of the nearest features with depth become points however far they are");
    v.field("levels", levels, {1, 12}, "", "of the image pyramid: FeatureOptions::levels");
    v.field(
        "search_radius_px", search_radius_px, {0.5, 50.0}, "px",
        "a known point is looked for so far around its projection at the pyramid's first level");
    v.field("max_hamming", max_hamming, {0, 256}, "", "between descriptors of the same point");
    v.field("min_parallax_deg", min_parallax_deg, {0.1, 45.0}, "deg",
            "between the rays a point without depth is made of, at least; ORB-SLAM2: cos 0.9998");
    v.field("min_found_share", min_found_share, {0.0, 1.0}, "",
            "a young point goes when it is found in fewer than this share of the frames it should "
            "be seen in");
    v.group("noise", noise);
  }
  void validate() const { validate_fields(*this, "PointMappingOptions"); }
};

/// How much a point is looked at: 2 for each sighting with depth, 1 without (ORB-SLAM2).
int observation_weight(const Map& map, const MapPoint& point);

class PointMapper {
 public:
  explicit PointMapper(const PointMappingOptions& options);

  /// Descriptor, viewing direction and distances of a point anew from its observations.
  void refresh(MapEditor& editor, Id point) const;
  /// Makes points of the key frame's features that are none yet and have depth: all close ones, and
  /// at least the min_points nearest. Returns how many.
  int add_by_depth(MapEditor& editor, Id key_frame);
  /// Makes points of features that look alike in the key frame and in another one, seen from places
  /// far enough apart. Returns how many.
  int add_by_parallax(MapEditor& editor, Id key_frame, std::span<const Id> others);
  /// The feature that a point is in a key frame whose camera is at T_camera_world; -1: none. Other
  /// points' features are not passed over. radius_factor: of the search radius; up to 1 a feature
  /// must also pass the chi-squared test.
  int find(const MapPoint& point, const KeyFrame& key_frame, const FeatureGrid& grid,
           const Rigid3d& T_camera_world, double radius_factor = 1.0) const;
  /// Looks for the points in the key frame. Found at a feature of another point, the one of fewer
  /// observations is replaced. Returns how many were found.
  int fuse(MapEditor& editor, Id key_frame, std::span<const Id> points,
           double radius_factor = 1.0) const;
  /// Drops an observation, and the point when too little is left of it.
  void drop(MapEditor& editor, Id point, Id key_frame) const;
  /// Removes young points that prove bad: found too seldom, or seen too little two key frames
  /// after the one that brought them.
  void cull(MapEditor& editor, Id newest_key_frame);

  /// The points that are young still, for saving.
  const std::vector<Id>& young() const { return young_; }
  void set_young(std::vector<Id> young) { young_ = std::move(young); }

 private:
  PointMappingOptions options_;
  std::vector<Id> young_;
};

}  // namespace weft::slam
