#pragma once

#include <map>
#include <optional>
#include <string>

#include "slam/map_copy.hpp"
#include "slam/tracker.hpp"

namespace weft::slam {

/// A pose of a frame and the landmarks it was found by.
struct PoseEstimate {
  Rigid3d T_camera_world;
  Matrix6d information = Matrix6d::Zero();  // as PoseResult's
  int observed_directions = 0;
  std::vector<Id> points, planes;          // one a feature or segment; points: those that agree
  std::vector<std::uint8_t> plane_agrees;  // one a segment
  int point_inliers = 0, plane_inliers = 0;
  int plane_directions = 0;  // that the agreeing planes' normals span

  /// Covariance of minus(T, T_camera_world); large along what is not determined.
  Matrix6d covariance() const;
};

/// A frame, or a key frame of the map, that another is compared with by looks.
struct PoseSource {
  const rgbd::CameraModel* camera = nullptr;
  std::span<const Feature> features;
  std::span<const Id> points;
  std::span<const plane::PlaneSegment> planes;
  std::span<const Id> plane_ids;
  Rigid3d T_camera_world;
};

/// The steps by which the tracker finds a frame's pose in its map. All are pure functions of the
/// map's copy and their arguments.
class PoseSearch {
 public:
  PoseSearch(const TrackerOptions& options, const MapCopy& map);

  Pyramid pyramid() const { return {options_.levels, options_.noise.level_scale}; }

  /// Looks for what the last frame saw where it should be at the predicted pose, within 15 px, or
  /// 30 px where that gives few; then optimises. sigma_rad, sigma_m: of the prediction.
  std::optional<PoseEstimate> by_motion(const FrameInput& input, const FeatureGrid& grid,
                                        const PlacedFrame& last, const Rigid3d& predicted,
                                        double sigma_rad, double sigma_m) const;

  /// Features that look alike anywhere in both, and all pairs of planes that may be the same, tell
  /// the motion between the two by RANSAC in space; then optimises.
  std::optional<PoseEstimate> by_looks(const FrameInput& input, const PoseSource& source) const;

  /// Looks for the local map's points around where the estimate has them, then for the planes, and
  /// optimises anew. factor: of the search radius. visible: gets each of the map's points that
  /// should be seen; may be nullptr.
  void by_local_map(const FrameInput& input, const FeatureGrid& grid,
                    std::span<const LocalPoint> local, double factor, PoseEstimate& estimate,
                    std::vector<Id>* visible) const;

  /// Local points for by_local_map: of key frames that see what the estimate does, and all that
  /// wait for the map.
  std::vector<LocalPoint> local(const PoseEstimate& estimate, Id reference) const;

  /// The key frame of the map that most of the estimate's points are in; kNoId: none.
  Id reference(const PoseEstimate& estimate) const;

  /// Why the estimate is not to be believed; empty: it is. least_points: that must agree where
  /// planes do not help; a third of that where these fix the rotation, a fifth where all.
  std::string objection(const PoseEstimate& estimate, int least_points) const;

  /// Whether several large planes are seen and none of them is where the estimate has the map's,
  /// with few points besides: then like corners of a furniture's other side may have been taken for
  /// each other, and a pose that planes agree with is to be preferred.
  bool doubtful(const FrameInput& input, const PoseEstimate& estimate) const;

 private:
  std::vector<Id> recognise_planes(const FrameInput& input, const Rigid3d& T_camera_world,
                                   const Matrix6d& covariance) const;
  /// What the map has seen three times stands still, what it has not may move, and be the greater
  /// part of what is seen: where enough of the former tells a pose, others that miss it by far are
  /// taken out of the estimate. Returns that pose, or the estimate's.
  Rigid3d keep_what_stands_still(const FrameInput& input, PoseEstimate& estimate) const;
  void optimise(const FrameInput& input, PoseEstimate& estimate) const;

  const TrackerOptions& options_;
  const MapCopy& map_;
};

}  // namespace weft::slam
