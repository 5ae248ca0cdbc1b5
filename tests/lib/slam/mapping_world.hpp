#pragma once

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "slam/absolute_orientation.hpp"
#include "slam/mapper.hpp"
#include "slam/plane_gate.hpp"
#include "synthetic_world.hpp"

/// A world of landmarks with descriptors and of rectangles, seen by a camera that moves through it,
/// and a tracker that knows the truth as far as a tracker can: where it is since the last key
/// frame, and which landmarks of the last few key frames it sees.
namespace weft::slam::test {

inline Descriptor any_descriptor(Random& random) {
  return {random.bits(), random.bits(), random.bits(), random.bits()};
}

struct Landmark {
  Eigen::Vector3d position_world;
  Eigen::Vector3d normal_world;  // seen from this side
  Descriptor descriptor;
  double size_m;  // its patch fills a feature's at level 0 at this distance
};

/// corner + a side_a + b side_b with a, b in [0, 1]; seen from the side of side_a x side_b.
struct Rectangle {
  Eigen::Vector3d corner, side_a, side_b;
  Eigen::Vector3d normal() const { return side_a.cross(side_b).normalized(); }
};

struct SeenFrame {
  FrameInput input;
  std::vector<int> landmarks;   // one a feature
  std::vector<int> rectangles;  // one a segment
  Rigid3d T_camera_world;       // the truth
};

class MappingWorld {
 public:
  explicit MappingWorld(int seed) : random_(static_cast<std::uint64_t>(seed)) {}

  std::vector<Landmark> landmarks;
  std::vector<Rectangle> rectangles;
  CameraModel camera = kinect();
  double sigma_px = 0.5;
  double inverse_depth_per_m = 0.0015;
  double depth_reach_m = 8.0;
  double tilt_rad = 0.004;
  double distance_m = 0.004;
  std::size_t features = 400;

  Random& random() { return random_; }

  int add_landmark(const Eigen::Vector3d& position, const Eigen::Vector3d& normal) {
    landmarks.push_back({position, normal, any_descriptor(random_), random_.uniform(2.0, 5.0)});
    return static_cast<int>(landmarks.size()) - 1;
  }
  /// A rectangle with landmarks all over it.
  void add_wall(const Rectangle& wall, int count) {
    rectangles.push_back(wall);
    for (int i = 0; i < count; ++i) {
      const double a = random_.uniform(), b = random_.uniform();
      add_landmark(wall.corner + a * wall.side_a + b * wall.side_b, wall.normal());
    }
  }
  /// Four walls and a floor, seen from inside; y points down, the floor is at height / 2.
  void add_room(const Eigen::Vector3d& centre, double side_m, double height_m, int a_wall) {
    const double h = 0.5 * side_m, v = 0.5 * height_m;
    const Eigen::Vector3d x(side_m, 0, 0), y(0, height_m, 0), z(0, 0, side_m);
    add_wall({centre + Eigen::Vector3d(-h, -v, h), y, x}, a_wall);
    add_wall({centre + Eigen::Vector3d(-h, -v, -h), x, y}, a_wall);
    add_wall({centre + Eigen::Vector3d(-h, -v, -h), y, z}, a_wall);
    add_wall({centre + Eigen::Vector3d(h, -v, -h), z, y}, a_wall);
    add_wall({centre + Eigen::Vector3d(-h, v, -h), x, z}, a_wall / 2);
  }

  SeenFrame see(std::int64_t frame, std::int64_t utime, const Rigid3d& T_camera_world) {
    SeenFrame out;
    out.T_camera_world = T_camera_world;
    out.input.frame = frame;
    out.input.utime = utime;
    out.input.camera = camera;
    const Eigen::Vector3d centre = T_camera_world.inverse().translation;
    for (std::size_t i = 0; i < landmarks.size() && out.input.features.size() < features; ++i) {
      const Landmark& landmark = landmarks[i];
      if (landmark.normal_world.dot(centre - landmark.position_world) <= 0.0) continue;
      const Eigen::Vector3d x = T_camera_world * landmark.position_world;
      if (x.z() < 0.3) continue;
      const Eigen::Vector2d pixel = camera.project(x);
      if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > camera.width - 1 ||
          pixel.y() > camera.height - 1)
        continue;
      Feature feature;
      feature.level =
          static_cast<int>(std::lround(std::log(landmark.size_m / x.norm()) / std::log(1.2) + 3.0));
      if (feature.level < 0 || feature.level > 7) continue;
      const double sigma = sigma_px * std::pow(1.2, feature.level);
      const double du = gauss(random_), dv = gauss(random_), dz = gauss(random_);
      feature.u_px = static_cast<float>(pixel.x() + sigma * du);
      feature.v_px = static_cast<float>(pixel.y() + sigma * dv);
      if (x.z() < depth_reach_m)
        feature.depth_m = static_cast<float>(x.z() + inverse_depth_per_m * x.z() * x.z() * dz);
      feature.descriptor = landmark.descriptor;
      for (int flip = 0; flip < 6; ++flip) {
        const auto bit = random_.below(256);
        feature.descriptor[bit / 64] ^= std::uint64_t{1} << (bit % 64);
      }
      out.input.features.push_back(feature);
      out.landmarks.push_back(static_cast<int>(i));
    }
    for (std::size_t k = 0; k < rectangles.size(); ++k) see_rectangle(k, T_camera_world, out);
    return out;
  }

 private:
  void see_rectangle(std::size_t k, const Rigid3d& T, SeenFrame& out) {
    const Rectangle& rectangle = rectangles[k];
    const Eigen::Vector3d normal_world = rectangle.normal();
    if (normal_world.dot(T.inverse().translation - rectangle.corner) < 0.05) return;
    plane::PlaneSegment segment;
    const double step = 0.1;
    const int columns = static_cast<int>(rectangle.side_a.norm() / step);
    const int rows = static_cast<int>(rectangle.side_b.norm() / step);
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < columns; ++i) {
      for (int j = 0; j < rows; ++j) {
        const Eigen::Vector3d x = T * (rectangle.corner + (i + 0.5) / columns * rectangle.side_a +
                                       (j + 0.5) / rows * rectangle.side_b);
        if (x.z() < 0.4 || x.z() > depth_reach_m) continue;
        const Eigen::Vector2d pixel = camera.project(x);
        if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > camera.width - 1 ||
            pixel.y() > camera.height - 1)
          continue;
        points.push_back(x);
        mean += x;
      }
    }
    if (points.size() < 8) return;
    mean /= static_cast<double>(points.size());
    // Noise about the centroid, then where the plane passes the origin.
    const Eigen::Vector3d n = T.rotation * normal_world;
    const auto [e0, e1] = plane::tangent_basis(n);
    const double t0 = tilt_rad * gauss(random_), t1 = tilt_rad * gauss(random_);
    const double h = distance_m * gauss(random_);
    segment.plane.normal = (n + t0 * e0 + t1 * e1).normalized();
    segment.plane.distance_m = segment.plane.normal.dot(mean) + h;
    const Eigen::Vector2d lever(e0.dot(mean), e1.dot(mean));
    segment.covariance.topLeftCorner<2, 2>() = tilt_rad * tilt_rad * Eigen::Matrix2d::Identity();
    segment.covariance.block<2, 1>(0, 2) = tilt_rad * tilt_rad * lever;
    segment.covariance.block<1, 2>(2, 0) = tilt_rad * tilt_rad * lever.transpose();
    segment.covariance(2, 2) = distance_m * distance_m + tilt_rad * tilt_rad * lever.squaredNorm();
    segment.cells = static_cast<int>(points.size());
    segment.plane.support = 400 * segment.cells;
    for (const auto& x : points) {
      const Eigen::Vector3d on = x - segment.plane.height_m(x) * segment.plane.normal;
      segment.points_camera.push_back(on.cast<float>());
    }
    out.input.planes.push_back(std::move(segment));
    out.rectangles.push_back(static_cast<int>(k));
  }

  Random random_;
};

/// At `position`, looking along the horizontal direction `yaw_rad` from +z towards +x.
inline Rigid3d standing_at(const Eigen::Vector3d& position, double yaw_rad) {
  return Rigid3d{exp_rotation({0.0, yaw_rad, 0.0}), position}.inverse();
}

/// Stands for the tracker: hands every frame to the mapper as a key frame.
class TruthfulTracker {
 public:
  TruthfulTracker(MappingWorld& world, Mapper& mapper) : world_(world), mapper_(mapper) {}

  double sigma_rad = 0.001;  // of the motion since the last key frame
  double sigma_m = 0.002;
  int recent = 5;  // key frames whose points it knows

  NewKeyFrame next(const Rigid3d& T_camera_world) {
    const std::int64_t frame = next_frame_;
    next_frame_ += 10;
    seen_.push_back(world_.see(frame, frame * 33333, T_camera_world));
    const SeenFrame& seen = seen_.back();
    NewKeyFrame out;
    out.input = seen.input;
    out.points.assign(seen.landmarks.size(), kNoId);
    out.planes.assign(seen.rectangles.size(), kNoId);
    const Map& map = mapper_.map();
    if (map.key_frames.empty()) {
      T_first_ = T_camera_world;
      return out;
    }
    out.map_version = map.version;
    const KeyFrame& last = map.key_frames.rbegin()->second;
    out.reference = last.id;
    const Rigid3d motion = T_camera_world * true_pose(last.id).inverse();
    out.T_camera_world =
        plus(motion, gauss6(world_.random(), sigma_rad, sigma_m)) * last.T_camera_world;
    std::map<int, Id> point_of, plane_of;
    auto key_frame = map.key_frames.rbegin();
    for (int k = 0; k < recent && key_frame != map.key_frames.rend(); ++k, ++key_frame) {
      const SeenFrame& then = seen_of(key_frame->first);
      for (std::size_t i = 0; i < then.landmarks.size(); ++i)
        if (key_frame->second.points[i] != kNoId)
          point_of.emplace(then.landmarks[i], key_frame->second.points[i]);
    }
    std::set<Id> used;
    for (std::size_t i = 0; i < seen.landmarks.size(); ++i) {
      const auto found = point_of.find(seen.landmarks[i]);
      if (found != point_of.end() && used.insert(found->second).second)
        out.points[i] = found->second;
    }
    return out;
  }

  MapUpdate step(const Rigid3d& T_camera_world) {
    const MapUpdate update = mapper_.add(next(T_camera_world));
    return update;
  }

  /// What a key frame of the map saw, by the frame it is of.
  const SeenFrame& seen_of(Id key_frame) const {
    return seen_[static_cast<std::size_t>(mapper_.map().key_frames.at(key_frame).frame / 10)];
  }
  Rigid3d true_pose(Id key_frame) const { return seen_of(key_frame).T_camera_world; }
  /// The true pose in the map's world: that of the first key frame.
  Rigid3d true_pose_in_map(Id key_frame) const { return true_pose(key_frame) * T_first_.inverse(); }
  const Rigid3d& T_first() const { return T_first_; }

  /// Root mean square distance of the key frames from the truth after the best rigid alignment.
  double aligned_error_m() const {
    std::vector<PointPair> pairs;
    for (const auto& [id, key_frame] : mapper_.map().key_frames)
      pairs.push_back(
          {true_pose(id).inverse().translation, key_frame.T_camera_world.inverse().translation});
    const auto T = absolute_orientation(pairs, {});
    double sum = 0.0;
    for (const auto& pair : pairs) sum += (*T * pair.point_b - pair.point_a).squaredNorm();
    return std::sqrt(sum / static_cast<double>(pairs.size()));
  }
  /// Largest errors of the key frames' poses.
  double worst_m() const {
    double worst = 0.0;
    for (const auto& [id, key_frame] : mapper_.map().key_frames)
      worst = std::max(worst, (key_frame.T_camera_world.inverse().translation -
                               true_pose_in_map(id).inverse().translation)
                                  .norm());
    return worst;
  }

 private:
  MappingWorld& world_;
  Mapper& mapper_;
  std::vector<SeenFrame> seen_;
  std::int64_t next_frame_ = 0;
  Rigid3d T_first_;
};

/// Key frames and landmarks agree about who sees what. Returns what does not, or "".
inline std::string inconsistency(const Map& map) {
  for (const auto& [id, point] : map.points) {
    if (point.observations.empty()) return "point " + std::to_string(id) + " is seen by none";
    for (std::size_t i = 0; i < point.observations.size(); ++i) {
      const auto& [key_frame, index] = point.observations[i];
      if (i > 0 && point.observations[i - 1].key_frame >= key_frame)
        return "observations of point " + std::to_string(id) + " are not in order";
      if (!map.key_frames.contains(key_frame) ||
          map.key_frames.at(key_frame).points.at(static_cast<std::size_t>(index)) != id)
        return "key frame " + std::to_string(key_frame) + " does not know of point " +
               std::to_string(id);
    }
  }
  for (const auto& [id, plane] : map.planes)
    for (const auto& [key_frame, index] : plane.observations)
      if (!map.key_frames.contains(key_frame) ||
          map.key_frames.at(key_frame).planes.at(static_cast<std::size_t>(index)).plane != id)
        return "key frame " + std::to_string(key_frame) + " does not know of plane " +
               std::to_string(id);
  for (const auto& [id, key_frame] : map.key_frames) {
    for (std::size_t i = 0; i < key_frame.points.size(); ++i) {
      const Id point = key_frame.points[i];
      if (point == kNoId) continue;
      const Observation expected{id, static_cast<int>(i)};
      if (!map.points.contains(point) ||
          std::count(map.points.at(point).observations.begin(),
                     map.points.at(point).observations.end(), expected) != 1)
        return "point " + std::to_string(point) + " does not know of key frame " +
               std::to_string(id);
    }
    for (std::size_t i = 0; i < key_frame.planes.size(); ++i) {
      const Id plane = key_frame.planes[i].plane;
      if (plane != kNoId && !map.planes.contains(plane))
        return "key frame " + std::to_string(id) + " sees a plane that is not there";
    }
    const bool root = id == map.key_frames.begin()->first;
    if (root ? key_frame.parent != kNoId : !map.key_frames.contains(key_frame.parent))
      return "key frame " + std::to_string(id) + " has no parent";
  }
  return "";
}

/// Two maps have the same entities, to the bit; counters of points aside, as updates leave these.
inline bool same(const Map& a, const Map& b) {
  const auto poses = [](const Rigid3d& x, const Rigid3d& y) {
    return x.rotation.coeffs() == y.rotation.coeffs() && x.translation == y.translation;
  };
  if (a.version != b.version || a.key_frames.size() != b.key_frames.size() ||
      a.points.size() != b.points.size() || a.planes.size() != b.planes.size())
    return false;
  for (const auto& [id, k] : a.key_frames) {
    if (!b.key_frames.contains(id)) return false;
    const KeyFrame& l = b.key_frames.at(id);
    if (k.frame != l.frame || !poses(k.T_camera_world, l.T_camera_world) || k.points != l.points ||
        k.keep != l.keep || k.parent != l.parent || k.loop_partners != l.loop_partners)
      return false;
    for (std::size_t i = 0; i < k.planes.size(); ++i)
      if (k.planes[i].plane != l.planes.at(i).plane) return false;
  }
  for (const auto& [id, p] : a.points) {
    if (!b.points.contains(id)) return false;
    const MapPoint& q = b.points.at(id);
    if (p.position_world != q.position_world || p.viewing_direction != q.viewing_direction ||
        p.max_distance_m != q.max_distance_m || p.descriptor != q.descriptor ||
        p.observations != q.observations)
      return false;
  }
  for (const auto& [id, p] : a.planes) {
    if (!b.planes.contains(id)) return false;
    const MapPlane& q = b.planes.at(id);
    if (p.normal_world != q.normal_world || p.distance_m != q.distance_m ||
        p.covariance != q.covariance || p.cloud_world != q.cloud_world ||
        p.observations != q.observations || p.sightings != q.sightings ||
        p.confirmed != q.confirmed)
      return false;
  }
  return true;
}

}  // namespace weft::slam::test
