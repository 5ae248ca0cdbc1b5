#pragma once

#include <set>
#include <vector>

#include "slam/bundle_adjustment.hpp"
#include "slam/map_points.hpp"

/// Bundle adjustment of a map, or of the part of it around a key frame.
namespace weft::slam {

struct AdjustmentOptions {
  int local_key_frames = 12;
  int fixed_key_frames = 20;
  int full_key_frames = 150;
  int full_observations = 40000;
  bool use_planes = true;
  BundleOptions bundle;

  void visit(OptionVisitor& v) {
    v.field("local_key_frames", local_key_frames, {1, 1000}, "",
            "the newest key frame and those that share most points with it: what moves after each");
    v.field("fixed_key_frames", fixed_key_frames, {1, 1000}, "",
            "others that see the same points and hold these in place, those that see most");
    v.field("full_key_frames", full_key_frames, {1, 10000}, "",
            "that move when a loop was closed, at most: those around it, by shared points");
    v.field("full_observations", full_observations, {1000, 10000000}, "",
            "of points in that adjustment, at most: a bound on its time; other points move with "
            "the key frame that brought them");
    v.field("use_planes", use_planes, "planes take part");
    v.group("bundle", bundle);
  }
  void validate() const { validate_fields(*this, "AdjustmentOptions"); }
};

struct AdjustmentReport {
  int key_frames = 0, fixed_key_frames = 0, points = 0, planes = 0;
  int point_observations = 0, plane_observations = 0;
  int dropped = 0;  // observations of points that failed the chi-squared test
  double chi_squared = 0.0;
  int degrees_of_freedom = 0;
};

/// The key frame and those that share most points with it, at most `count` in all.
std::set<Id> window(const Map& map, Id key_frame, int count);

/// Moves the key frames, the points they see and the believed planes they see to the least sum of
/// squares; others that see these are fixed. The map's first key frame never moves. Observations
/// that do not fit are dropped; planes get their covariances. max_observations: of points; the
/// points with most are taken.
AdjustmentReport adjust(MapEditor& editor, const PointMapper& points, const SensorNoise& noise,
                        const std::set<Id>& key_frames, int max_observations,
                        const AdjustmentOptions& options);

}  // namespace weft::slam
