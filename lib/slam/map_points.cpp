#include "slam/map_points.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "slam/chi_squared.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

const Feature& feature_at(const KeyFrame& key_frame, int index) {
  return key_frame.features[static_cast<std::size_t>(index)];
}

/// Squared Mahalanobis distance of a point from where a feature says it is; infinite behind.
double chi_squared(const rgbd::CameraModel& camera, const PointObservation& seen,
                   const Eigen::Vector3d& point_camera) {
  const PointResidual r = point_residual(camera, seen, point_camera);
  return r.in_front ? r.e.squaredNorm() : std::numeric_limits<double>::infinity();
}

bool fits(const rgbd::CameraModel& camera, const PointObservation& seen,
          const Eigen::Vector3d& point_camera) {
  return chi_squared(camera, seen, point_camera) <= chi_squared_95(seen.dimension());
}

/// The descriptor whose median distance to the others is least, of equals the first.
Descriptor most_typical(const std::vector<Descriptor>& descriptors) {
  std::size_t best = 0;
  int least = std::numeric_limits<int>::max();
  std::vector<int> distances(descriptors.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    for (std::size_t j = 0; j < descriptors.size(); ++j)
      distances[j] = hamming_distance(descriptors[i], descriptors[j]);
    const auto middle = distances.begin() + static_cast<std::ptrdiff_t>((distances.size() - 1) / 2);
    std::nth_element(distances.begin(), middle, distances.end());
    if (*middle < least) {
      least = *middle;
      best = i;
    }
  }
  return descriptors[best];
}

}  // namespace

int observation_weight(const Map& map, const MapPoint& point) {
  int weight = 0;
  for (const auto& [key_frame, feature] : point.observations)
    weight += feature_at(map.key_frames.at(key_frame), feature).depth_m > 0.0f ? 2 : 1;
  return weight;
}

PointMapper::PointMapper(const PointMappingOptions& options) : options_(options) {
  options_.validate();
}

void PointMapper::refresh(MapEditor& editor, Id id) const {
  // Of many observations the newest tell: what a point looks like changes with time.
  constexpr std::size_t kMost = 20;
  MapPoint& point = editor.edit_point(id);
  if (point.observations.empty()) return;
  std::vector<Descriptor> descriptors;
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  const auto& seen = point.observations;
  for (std::size_t i = seen.size() > kMost ? seen.size() - kMost : 0; i < seen.size(); ++i) {
    const KeyFrame& key_frame = editor.key_frame(seen[i].key_frame);
    descriptors.push_back(feature_at(key_frame, seen[i].index).descriptor);
    direction +=
        (point.position_world - key_frame.T_camera_world.inverse().translation).normalized();
  }
  point.descriptor = most_typical(descriptors);
  if (direction.norm() > 1e-9) point.viewing_direction = direction.normalized();
  const KeyFrame& first = editor.key_frame(seen.front().key_frame);
  const double distance =
      (point.position_world - first.T_camera_world.inverse().translation).norm();
  const double scale = options_.noise.level_scale;
  point.max_distance_m = distance * std::pow(scale, feature_at(first, seen.front().index).level);
  point.min_distance_m = point.max_distance_m / std::pow(scale, options_.levels - 1);
}

int PointMapper::add_by_depth(MapEditor& editor, Id key_frame_id) {
  const KeyFrame& key_frame = editor.key_frame(key_frame_id);
  std::vector<std::pair<float, int>> by_depth;
  for (std::size_t i = 0; i < key_frame.features.size(); ++i) {
    const float depth = key_frame.features[i].depth_m;
    if (depth > 0.0f) by_depth.emplace_back(depth, static_cast<int>(i));
  }
  std::sort(by_depth.begin(), by_depth.end());
  const Rigid3d T_world_camera = key_frame.T_camera_world.inverse();
  int made = 0, nearest = 0;
  for (const auto& [depth, index] : by_depth) {
    if (depth > options_.close_m && nearest >= options_.min_points) break;
    ++nearest;
    if (key_frame.points[static_cast<std::size_t>(index)] != kNoId) continue;
    const Feature& feature = feature_at(key_frame, index);
    const Id id = editor.add_point(
        T_world_camera * key_frame.camera.unproject(feature.u_px, feature.v_px, depth),
        key_frame_id);
    editor.observe_point(id, key_frame_id, index);
    editor.count(id, 1, 1);
    refresh(editor, id);
    young_.push_back(id);
    ++made;
  }
  return made;
}

int PointMapper::add_by_parallax(MapEditor& editor, Id key_frame_id, std::span<const Id> others) {
  const double max_cosine = std::cos(options_.min_parallax_deg * std::numbers::pi / 180.0);
  const auto unmatched = [&](const KeyFrame& key_frame, std::vector<int>& indices) {
    std::vector<Feature> features;
    indices.clear();
    for (std::size_t i = 0; i < key_frame.features.size(); ++i) {
      if (key_frame.points[i] != kNoId) continue;
      features.push_back(key_frame.features[i]);
      indices.push_back(static_cast<int>(i));
    }
    return features;
  };
  int made = 0;
  const KeyFrame& a = editor.key_frame(key_frame_id);
  const Rigid3d T_world_a = a.T_camera_world.inverse();
  std::vector<int> indices_a, indices_b;
  for (const Id other : others) {
    const KeyFrame& b = editor.key_frame(other);
    const Rigid3d T_world_b = b.T_camera_world.inverse();
    if ((T_world_a.translation - T_world_b.translation).norm() < 0.02) continue;
    const auto features_a = unmatched(a, indices_a), features_b = unmatched(b, indices_b);
    for (const Match& match : match_by_looks(features_a, features_b, options_.max_hamming, 0.8)) {
      const Feature& fa = features_a[static_cast<std::size_t>(match.sought)];
      const Feature& fb = features_b[static_cast<std::size_t>(match.feature)];
      const Eigen::Vector3d ray_a =
          (T_world_a.rotation * a.camera.unproject(fa.u_px, fa.v_px, 1.0)).normalized();
      const Eigen::Vector3d ray_b =
          (T_world_b.rotation * b.camera.unproject(fb.u_px, fb.v_px, 1.0)).normalized();
      const double cosine = ray_a.dot(ray_b);
      if (cosine > max_cosine || cosine < 0.0) continue;
      // The middle of where the rays come nearest to each other.
      const Eigen::Vector3d between = T_world_b.translation - T_world_a.translation;
      const double sine_squared = 1.0 - cosine * cosine;
      const double along_a = (between.dot(ray_a) - cosine * between.dot(ray_b)) / sine_squared;
      const double along_b = (cosine * between.dot(ray_a) - between.dot(ray_b)) / sine_squared;
      if (!(along_a > 0.0 && along_b > 0.0)) continue;
      const Eigen::Vector3d point =
          0.5 * (T_world_a.translation + along_a * ray_a + T_world_b.translation + along_b * ray_b);
      if (!fits(a.camera, observe(fa, options_.noise), a.T_camera_world * point) ||
          !fits(b.camera, observe(fb, options_.noise), b.T_camera_world * point))
        continue;
      // A patch's size in the picture goes with its nearness.
      const double size_ratio = along_b / along_a;
      const double level_ratio = std::pow(options_.noise.level_scale, fa.level - fb.level);
      const double tolerance = 1.5 * options_.noise.level_scale;
      if (size_ratio > level_ratio * tolerance || size_ratio * tolerance < level_ratio) continue;
      const Id id = editor.add_point(point, key_frame_id);
      editor.observe_point(id, key_frame_id, indices_a[static_cast<std::size_t>(match.sought)]);
      editor.observe_point(id, other, indices_b[static_cast<std::size_t>(match.feature)]);
      editor.count(id, 1, 1);
      refresh(editor, id);
      young_.push_back(id);
      ++made;
    }
  }
  return made;
}

int PointMapper::find(const MapPoint& point, const KeyFrame& key_frame, const FeatureGrid& grid,
                      const Rigid3d& T_camera_world, double radius_factor) const {
  const auto& camera = key_frame.camera;
  const Eigen::Vector3d point_camera = T_camera_world * point.position_world;
  if (point_camera.z() < kMinDepth_m) return -1;
  const Eigen::Vector2d pixel = camera.project(point_camera);
  if (!(pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() < camera.width &&
        pixel.y() < camera.height))
    return -1;
  const double distance = point_camera.norm();
  if (distance < 0.8 * point.min_distance_m || distance > 1.2 * point.max_distance_m) return -1;
  if (point_camera.dot(T_camera_world.rotation * point.viewing_direction) < 0.5 * distance)
    return -1;
  const double scale = options_.noise.level_scale;
  const double levels =
      std::log(point.max_distance_m / distance) / std::log(std::max(scale, 1.001));
  const int level = std::clamp(static_cast<int>(std::ceil(levels - 1e-9)), 0, options_.levels - 1);
  const double radius = radius_factor * options_.search_radius_px * std::pow(scale, level);
  int best = -1, least = options_.max_hamming + 1;
  grid.near(pixel.x(), pixel.y(), radius, [&](int index) {
    const Feature& feature = feature_at(key_frame, index);
    if (feature.level < level - 1 || feature.level > level + 1) return;
    const int hamming = hamming_distance(point.descriptor, feature.descriptor);
    if (hamming > least || (hamming == least && index > best)) return;
    // A wider search is for a pose or a point that is not exact.
    if (radius_factor <= 1.0 && !fits(camera, observe(feature, options_.noise), point_camera))
      return;
    best = index;
    least = hamming;
  });
  return best;
}

int PointMapper::fuse(MapEditor& editor, Id key_frame_id, std::span<const Id> points,
                      double radius_factor) const {
  const KeyFrame& key_frame = editor.key_frame(key_frame_id);
  const FeatureGrid grid(key_frame.features, key_frame.camera.width, key_frame.camera.height);
  int found = 0;
  for (const Id id : points) {
    const auto place = editor.map().points.find(id);
    if (place == editor.map().points.end()) continue;  // replaced on the way
    const MapPoint& point = place->second;
    if (std::any_of(point.observations.begin(), point.observations.end(),
                    [&](const Observation& o) { return o.key_frame == key_frame_id; }))
      continue;
    const int index = find(point, key_frame, grid, key_frame.T_camera_world, radius_factor);
    if (index < 0) continue;
    ++found;
    const Id other = key_frame.points[static_cast<std::size_t>(index)];
    if (other == kNoId) {
      editor.observe_point(id, key_frame_id, index);
      refresh(editor, id);
    } else if (editor.point(other).observations.size() > point.observations.size()) {
      editor.replace_point(id, other);
      refresh(editor, other);
    } else {
      editor.replace_point(other, id);
      refresh(editor, id);
    }
  }
  return found;
}

void PointMapper::drop(MapEditor& editor, Id id, Id key_frame) const {
  editor.unobserve_point(id, key_frame);
  if (observation_weight(editor.map(), editor.point(id)) <= 2)
    editor.remove_point(id);
  else
    refresh(editor, id);
}

void PointMapper::cull(MapEditor& editor, Id newest_key_frame) {
  std::erase_if(young_, [&](Id id) {
    const auto found = editor.map().points.find(id);
    if (found == editor.map().points.end()) return true;
    const MapPoint& point = found->second;
    const auto& key_frames = editor.map().key_frames;
    const auto since = std::distance(key_frames.lower_bound(point.first_key_frame),
                                     key_frames.find(newest_key_frame));
    const bool seldom = point.found < options_.min_found_share * point.visible;
    if (seldom || (since >= 2 && observation_weight(editor.map(), point) <= 3)) {
      editor.remove_point(id);
      return true;
    }
    return since >= 3;
  });
}

}  // namespace weft::slam
