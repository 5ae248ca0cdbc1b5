#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <vector>

#include "plane/extractor.hpp"
#include "rgbd/camera_model.hpp"
#include "slam/features.hpp"
#include "slam/rigid3d.hpp"

/// The map and its changes. The mapper owns the map; a tracker holds a copy that MapUpdates keep.
/// Ordered containers: whoever walks over them meets the same order in every run.
namespace weft::slam {

using Id = std::int64_t;  // counts up from 0 for each kind of landmark, never used again
inline constexpr Id kNoId = -1;

/// A plane seen in a key frame.
struct PlaneSighting {
  plane::PlaneSegment segment;  // camera frame
  Id plane = kNoId;             // follows from the plane's observations
};

struct KeyFrame {
  Id id = kNoId;
  std::int64_t frame = 0;  // its place in the sequence (seq of the RGBD_FRAME)
  std::int64_t utime = 0;  // us, of the measurement
  rgbd::CameraModel camera;
  Rigid3d T_camera_world;
  std::vector<Feature> features;
  std::vector<Id> points;  // one a feature; follows from the points' observations
  std::vector<PlaneSighting> planes;
  bool keep = false;  // brought a new plane: never culled
  Id parent = kNoId;  // key frame it shared most points with when it came; spanning tree
  std::vector<Id> loop_partners;  // key frames a closed loop ties it to
};

struct Observation {
  Id key_frame = kNoId;
  int index = 0;  // of the feature or of the plane sighting there
  bool operator==(const Observation&) const = default;
};

struct MapPoint {
  Id id = kNoId;
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d viewing_direction = Eigen::Vector3d::UnitZ();  // mean, camera to point, world
  double min_distance_m = 0.0;  // from where its scale lies within the pyramid
  double max_distance_m = 0.0;
  Descriptor descriptor{};                // the one with the least median distance to the others
  std::vector<Observation> observations;  // by key frame, at most one in each
  Id first_key_frame = kNoId;
  int visible = 0;  // frames in which it should have been seen
  int found = 0;    // and was
};

struct MapPlane {
  Id id = kNoId;
  Eigen::Vector3d normal_world = Eigen::Vector3d::UnitZ();  // to the side it was seen from
  double distance_m = 0.0;                                  // normal_world . x = distance_m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();     // as PlaneSegment's; zero: not known
  std::vector<Eigen::Vector3f> cloud_world;                 // one point a voxel
  std::vector<Observation> observations;                    // by key frame, may repeat in one
  int sightings = 0;                                        // frames it was seen in
  bool confirmed = false;
};

struct Map {
  std::int64_t version = 0;  // counts its changes; 0: empty
  std::map<Id, KeyFrame> key_frames;
  std::map<Id, MapPoint> points;
  std::map<Id, MapPlane> planes;
};

/// What changed from one version to a later one: entities that are new or changed, whole, and the
/// ids of those that went. Of a key frame only the pose and the ties to others ever change.
struct MapUpdate {
  std::int64_t from_version = 0;  // 0: this is the whole map
  std::int64_t to_version = 0;
  std::int64_t frame = 0;  // the last frame that is in it
  struct Change {
    Id id = kNoId;
    Rigid3d T_camera_world;
    bool keep = false;
    Id parent = kNoId;
    std::vector<Id> loop_partners;
  };
  std::vector<KeyFrame> new_key_frames;
  std::vector<Change> key_frames;
  std::vector<MapPoint> points;
  std::vector<MapPlane> planes;
  std::vector<Id> removed_key_frames, removed_points, removed_planes;
};

/// Brings a copy from the update's first version to its last. An update of the whole map replaces
/// the copy. Throws Error when the copy is at another version (ask for the whole map then), or when
/// an observation names a key frame, feature or plane that is not there.
void apply(const MapUpdate& update, Map& map);

/// The whole map as an update. `frame`: the last frame that is in it.
MapUpdate whole_map(const Map& map, std::int64_t frame);

/// Key frames that see at least `min_shared` of the same points, most first, then by id.
struct Neighbour {
  Id key_frame = kNoId;
  int shared = 0;
};
std::vector<Neighbour> neighbours(const Map& map, const KeyFrame& key_frame, int min_shared);

}  // namespace weft::slam
