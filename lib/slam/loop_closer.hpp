#pragma once

#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "slam/map_adjustment.hpp"
#include "slam/map_planes.hpp"
#include "slam/map_points.hpp"
#include "slam/place_index.hpp"
#include "slam/pose_graph.hpp"
#include "slam/pose_optimiser.hpp"
#include "slam/vocabulary.hpp"

/// Places seen again: found by words, verified by geometry, and the drift since taken out of the
/// map. After ORB-SLAM2 with the scale fixed; planes vote as well.
namespace weft::slam {

struct LoopOptions {
  bool close = true;
  int key_frames_between = 10;
  double min_shared_share = 0.8;
  int consistent = 3;
  int min_matches = 20;
  int min_inliers = 20;
  int min_projected = 40;
  int candidates = 5;
  double max_drift_m = 0.1;
  double max_drift_share = 0.05;
  double max_drift_deg = 5.0;
  double max_drift_deg_per_m = 1.0;
  double max_disagreement_m = 0.2;
  double edge_sigma_deg = 0.2;
  double edge_sigma_m = 0.005;
  int strong_covisibility = 100;
  double max_strain = 16.0;
  PoseGraphOptions graph;

  void visit(OptionVisitor& v) {
    v.field("close", close, "look for loops and close them");
    v.field("key_frames_between", key_frames_between, {1, 100000}, "",
            "since the last loop, and between the two ends of one; ORB-SLAM2: 10");
    v.field("min_shared_share", min_shared_share, {0.0, 1.0}, "",
            "of the most words that any place shares: what a candidate shares at least");
    v.field("consistent", consistent, {0, 100}, "",
            "so many key frames before this one had a candidate near by as well; ORB-SLAM2: 3");
    v.field("min_matches", min_matches, {4, 10000}, "", "of points by looks; ORB-SLAM2: 20");
    v.field("min_inliers", min_inliers, {4, 10000}, "", "of one rigid motion; ORB-SLAM2: 20");
    v.field("min_projected", min_projected, {4, 10000}, "",
            "matches with the points around the candidate at the motion found; ORB-SLAM2: 40");
    v.field("candidates", candidates, {1, 100}, "", "that are verified for a key frame, at most");
    v.field("max_drift_m", max_drift_m, {0.0, 100.0}, "m",
            "a loop that moves the camera by more than this and max_drift_share of the way since "
            "is none: the same furniture stands somewhere else");
    v.field("max_drift_share", max_drift_share, {0.0, 1.0}, "", "see max_drift_m");
    v.field("max_drift_deg", max_drift_deg, {0.0, 180.0}, "deg", "likewise for its rotation ...");
    v.field("max_drift_deg_per_m", max_drift_deg_per_m, {0.0, 90.0}, "deg/m", "... with the way");
    v.field("max_disagreement_m", max_disagreement_m, {0.0, 100.0}, "m",
            "two candidates that are both verified but place the camera farther apart than this: "
            "neither is believed");
    v.field("edge_sigma_deg", edge_sigma_deg, {0.001, 10.0}, "deg",
            "of the relative rotation of two key frames in the pose graph");
    v.field("edge_sigma_m", edge_sigma_m, {1e-5, 1.0}, "m", "likewise their translation");
    v.field("strong_covisibility", strong_covisibility, {1, 10000}, "",
            "key frames that share so many points are tied in the pose graph; ORB-SLAM2: 100");
    v.field("max_strain", max_strain, {1.0, 1e9}, "",
            "largest chi-squared a tie of the pose graph may have when the loop is closed");
    v.group("graph", graph);
  }
  void validate() const { validate_fields(*this, "LoopOptions"); }
};

struct Loop {
  Id key_frame = kNoId;
  Id partner = kNoId;
  Rigid3d T_camera_world;  // of the key frame, where the partner's part of the map has it
  int matches = 0;         // points of that part it sees
  double moved_m = 0.0;    // from where the map had it
};

class LoopCloser {
 public:
  /// vocabulary: not nullptr.
  LoopCloser(const LoopOptions& options, const SensorNoise& noise,
             std::shared_ptr<const BinaryVocabulary> vocabulary);

  /// Makes a key frame a place that can be found again.
  void add(const KeyFrame& key_frame);
  void remove(Id key_frame);
  int places() const { return index_.size(); }

  /// The loop that the newest key frame closes. To be called for each key frame, after add().
  std::optional<Loop> detect(const Map& map, const PointMapper& points, Id key_frame);

  /// Takes the drift out of the map: pose graph, then points and planes with their key frames, then
  /// duplicates fused. Returns false, and changes nothing, when the pose graph cannot take the loop
  /// without breaking. The adjustment of it all is the caller's.
  bool close(MapEditor& editor, const PointMapper& points, const PlaneMapper& planes,
             const Loop& loop);

 private:
  std::vector<Id> consistent_candidates(const Map& map, Id key_frame);
  std::optional<Loop> verify(const Map& map, const PointMapper& points, Id key_frame,
                             Id candidate) const;
  bool plausible(const Map& map, Loop& loop) const;

  LoopOptions options_;
  SensorNoise noise_;
  std::shared_ptr<const BinaryVocabulary> vocabulary_;
  PlaceIndex index_;
  struct Group {
    std::set<Id> key_frames;
    int consistency = 0;
  };
  std::vector<Group> groups_;
  Id last_loop_ = kNoId;
};

}  // namespace weft::slam
