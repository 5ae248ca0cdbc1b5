#pragma once

#include <memory>

#include "slam/loop_closer.hpp"
#include "slam/map_adjustment.hpp"
#include "slam/map_file.hpp"
#include "slam/map_planes.hpp"
#include "slam/map_points.hpp"
#include "slam/pose_optimiser.hpp"
#include "slam/tracking.hpp"
#include "slam/vocabulary.hpp"

namespace weft::slam {

struct MapperOptions {
  bool use_planes = true;
  int neighbours = 10;
  double pose_sigma_m = 0.05;
  double pose_sigma_deg = 2.0;
  double redundant_share = 0.9;
  int redundant_views = 3;
  PointMappingOptions points;
  PlaneMappingOptions planes;
  AdjustmentOptions adjustment;
  LoopOptions loops;
  PoseOptions pose;

  void visit(OptionVisitor& v) {
    v.field("use_planes", use_planes, "planes become part of the map and of its optimisation");
    v.field("neighbours", neighbours, {1, 100}, "",
            "key frames that share most points with a new one: points are fused and triangulated "
            "with these; ORB-SLAM2: 10");
    v.field("pose_sigma_m", pose_sigma_m, {1e-3, 10.0}, "m",
            "how well the pose of a new key frame is known at least, in each direction: what the "
            "tracker vouches for");
    v.field("pose_sigma_deg", pose_sigma_deg, {0.01, 90.0}, "deg", "likewise its rotation");
    v.field("redundant_share", redundant_share, {0.0, 1.0}, "",
            "a key frame goes when more than this share of its close points are seen in ...");
    v.field("redundant_views", redundant_views, {1, 100}, "",
            "... at least so many others at the same or a finer scale; ORB-SLAM2: 0.9, 3");
    v.group("points", points);
    v.group("planes", planes);
    v.group("adjustment", adjustment);
    v.group("loops", loops);
    v.group("pose", pose);
  }
  void validate() const { validate_fields(*this, "MapperOptions"); }
};

/// The owner of the map: takes key frames in, gives back what they change. A pure function of the
/// key frames given, in their order: the same bits each time. All bounds on time are counts.
class Mapper {
 public:
  /// vocabulary: finds loops; nullptr: none are closed. Throws Error.
  Mapper(const MapperOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary);
  /// Goes on with a saved map as if it had never stopped, but for loops that were about to be
  /// closed. saved.frame = -1: with a new session, whose frames count from 0 again. Its tracker
  /// needs whole_map(map(), frame()). Throws Error on a map that another editor could not have
  /// made.
  Mapper(const MapperOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary,
         SavedMap saved);
  ~Mapper();
  Mapper(Mapper&&) noexcept;
  Mapper& operator=(Mapper&&) noexcept;

  /// Adds a key frame, tracked in a version of the map at most MapEditor::kRemembered back: its
  /// pose and points are carried over to the present one. The first starts the map; its pose is
  /// fixed. Throws Error, and changes nothing, on a key frame that cannot be: sizes that do not
  /// fit, values that are not finite, another camera than the map's, a frame that is in the map or
  /// before it, a version that is not known.
  MapUpdate add(const NewKeyFrame& key_frame);

  const Map& map() const;
  /// The last frame that is in it; -1: none.
  std::int64_t frame() const;

  SavedMap saved() const;

  /// What add() did, for logs and tests.
  struct Report {
    Id key_frame = kNoId;
    int tracked = 0;   // points it came with that are in the map still
    int found = 0;     // further ones found by projection
    int by_depth = 0;  // points made
    int by_parallax = 0;
    bool new_planes = false;
    int planes_merged = 0;
    AdjustmentReport adjustment;
    int key_frames_culled = 0;
    std::optional<Loop> loop;   // that was closed
    bool loop_refused = false;  // found, but the pose graph could not take it
    AdjustmentReport full_adjustment;
  };
  const Report& report() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace weft::slam
