#pragma once

#include <span>
#include <vector>

#include "slam/map.hpp"
#include "slam/matching.hpp"

namespace weft::slam {

/// A point that a frame may show, of the map or not yet in it.
struct LocalPoint {
  Id id = kNoId;
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d viewing_direction = Eigen::Vector3d::UnitZ();  // camera to point, world
  double min_distance_m = 0.0, max_distance_m = 0.0;             // as MapPoint's
  Descriptor descriptor{};
};

LocalPoint local_point(const MapPoint& point);

/// Distances between which a feature's scale lies within the pyramid: (least, most), as MapPoint
/// has them. distance_m: from where it was seen at `level`.
std::pair<double, double> scale_range_m(double distance_m, int level, int levels, double scale);

/// The key frames that see most of these points (with the points a few of the same), most first,
/// then those that share most with the first ones; at most `most`. points: ids, those that are not
/// in the map are passed over; `reference` comes in where no point is known.
std::vector<Id> local_key_frames(const Map& map, std::span<const Id> points, Id reference,
                                 int most);

/// The points of these key frames, each once, in the order of first meeting.
std::vector<LocalPoint> local_points(const Map& map, std::span<const Id> key_frames);

/// Where to look for a point in a frame, or nothing where it lies outside the picture, behind the
/// camera, too near or far for its scale, or is seen from more than 60 degrees aside.
struct Pyramid {
  int levels = 8;
  double scale = 1.2;
};
bool project(const LocalPoint& point, const rgbd::CameraModel& camera,
             const Rigid3d& T_camera_world, const Pyramid& pyramid, double radius_px, Sought& out);

}  // namespace weft::slam
