#include "slam/map_planes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>

#include "slam/chi_squared.hpp"
#include "slam/plane_gate.hpp"
#include "slam/residuals.hpp"
#include "slam/sensor_noise.hpp"

namespace weft::slam {
namespace {

using Voxel = std::array<std::int32_t, 3>;

Voxel voxel_of(const Eigen::Vector3f& point, double side_m) {
  const auto number = [&](float x) {  // what does not fit lies at the border
    const double at = std::floor(static_cast<double>(x) / side_m);
    return static_cast<std::int32_t>(std::clamp(at, -1e9, 1e9));
  };
  return {number(point.x()), number(point.y()), number(point.z())};
}

std::set<Voxel> voxels_of(std::span<const Eigen::Vector3f> cloud, double side_m) {
  std::set<Voxel> out;
  for (const auto& point : cloud) out.insert(voxel_of(point, side_m));
  return out;
}

std::vector<Eigen::Vector3f> in_world(std::span<const Eigen::Vector3f> points_camera,
                                      const Rigid3d& T_camera_world) {
  const Rigid3d T_world_camera = T_camera_world.inverse();
  std::vector<Eigen::Vector3f> out;
  for (const auto& point : points_camera)
    out.push_back((T_world_camera * point.cast<double>().eval()).cast<float>());
  return out;
}

/// Whether a point of one cloud is within reach of one of the other, to the size of a cube of that
/// side.
bool near(std::span<const Eigen::Vector3f> cloud, const std::set<Voxel>& occupied, double side_m) {
  for (const auto& point : cloud) {
    const Voxel middle = voxel_of(point, side_m);
    for (int x = -1; x <= 1; ++x) {
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z)
          if (occupied.contains({middle[0] + x, middle[1] + y, middle[2] + z})) return true;
    }
  }
  return false;
}

const plane::PlaneSegment& segment_of(const Map& map, const Observation& observation) {
  return map.key_frames.at(observation.key_frame)
      .planes[static_cast<std::size_t>(observation.index)]
      .segment;
}

PlaneState state_of(const MapPlane& plane) { return {plane.normal_world, plane.distance_m, false}; }

}  // namespace

PlaneMapper::PlaneMapper(const PlaneMappingOptions& options) : options_(options) {
  options_.validate();
}

/// Two segments of one picture: neither the pose nor the sensor's depth scale tells them apart, so
/// their own scatter and small floors do.
bool PlaneMapper::are_one(const plane::PlaneSegment& a, const plane::PlaneSegment& b) const {
  if (a.plane.normal.dot(b.plane.normal) <= 0.0) return false;
  const auto& [small, large] = a.cells < b.cells ? std::tie(a, b) : std::tie(b, a);
  // Compared where the smaller is seen, not where its plane goes on to.
  Eigen::Vector3d centre = small.plane.distance_m * small.plane.normal;
  if (!small.points_camera.empty()) {
    centre.setZero();
    for (const auto& point : small.points_camera) centre += point.cast<double>();
    centre /= static_cast<double>(small.points_camera.size());
  }
  const double floor_m = options_.same_frame_distance_m * std::max(1.0, centre.z() * centre.z());
  if (std::abs(large.plane.height_m(centre)) > 3.0 * std::numbers::sqrt2 * floor_m) return false;
  const PlaneNoise noise{options_.same_frame_tilt_deg, std::min(floor_m, 0.2)};
  return plane_distance({small.plane.normal, small.plane.distance_m, false},
                        with_floors(small.covariance, noise), observe(large), Rigid3d{},
                        Matrix6d::Zero(), noise) <= chi_squared_95(3);
}

bool PlaneMapper::associate(MapEditor& editor, Id key_frame_id,
                            const Matrix6d& pose_covariance) const {
  const KeyFrame& key_frame = editor.key_frame(key_frame_id);
  std::vector<plane::PlaneSegment> segments;
  std::set<Voxel> seen;
  for (const auto& sighting : key_frame.planes) {
    segments.push_back(sighting.segment);
    const auto points = in_world(sighting.segment.points_camera, key_frame.T_camera_world);
    for (const auto& point : points) seen.insert(voxel_of(point, options_.max_gap_m));
  }
  std::vector<KnownPlane> known;
  std::vector<Id> ids;
  for (const auto& [id, plane] : editor.map().planes) {
    if (!near(plane.cloud_world, seen, options_.max_gap_m)) continue;
    known.push_back({state_of(plane), plane.covariance});
    ids.push_back(id);
  }
  const auto matched =
      match_planes(segments, known, key_frame.T_camera_world, pose_covariance, options_.match);
  std::vector<Id> plane_of(segments.size(), kNoId);
  for (std::size_t s = 0; s < segments.size(); ++s) {
    if (matched[s] < 0) continue;
    const Id id = ids[static_cast<std::size_t>(matched[s])];
    const auto points = in_world(segments[s].points_camera, key_frame.T_camera_world);
    if (near(points, voxels_of(editor.plane(id).cloud_world, options_.max_gap_m),
             options_.max_gap_m))
      plane_of[s] = id;
  }
  // The rest by the segments beside it: largest first, as they come.
  bool new_ones = false;
  for (std::size_t s = 0; s < segments.size(); ++s) {
    for (std::size_t other = 0; other < segments.size() && plane_of[s] == kNoId; ++other) {
      if (plane_of[other] != kNoId && are_one(segments[s], segments[other]) &&
          near(segments[s].points_camera,
               voxels_of(segments[other].points_camera, options_.max_gap_m), options_.max_gap_m))
        plane_of[s] = plane_of[other];
    }
    if (plane_of[s] == kNoId) {
      const PlaneState state = slam::in_world(segments[s].plane, key_frame.T_camera_world);
      plane_of[s] = editor.add_plane(state.normal_world, state.distance_m);
      editor.edit_plane(plane_of[s]).covariance = covariance_in_world(
          segments[s].plane, with_floors(segments[s].covariance, options_.match.noise),
          key_frame.T_camera_world, pose_covariance);
      new_ones = true;
    }
  }
  for (std::size_t s = 0; s < segments.size(); ++s)
    add_sighting(editor, plane_of[s], key_frame_id, static_cast<int>(s));
  return new_ones;
}

void PlaneMapper::add_sighting(MapEditor& editor, Id id, Id key_frame_id, int segment) const {
  editor.observe_plane(id, key_frame_id, segment);
  const KeyFrame& key_frame = editor.key_frame(key_frame_id);
  MapPlane& plane = editor.edit_plane(id);
  auto occupied = voxels_of(plane.cloud_world, options_.voxel_m);
  const auto& points = key_frame.planes[static_cast<std::size_t>(segment)].segment.points_camera;
  for (const auto& point : in_world(points, key_frame.T_camera_world))
    if (occupied.insert(voxel_of(point, options_.voxel_m)).second)
      plane.cloud_world.push_back(point);
}

void PlaneMapper::judge(MapEditor& editor, Id key_frame_id, std::span<const Sightings> seen,
                        double frame_s) const {
  std::map<Id, int> found;
  for (const auto& [id, visible, times] : seen)
    if (editor.map().planes.contains(id)) found[id] = std::max(0, times);
  for (const auto& sighting : editor.key_frame(key_frame_id).planes)
    if (sighting.plane != kNoId) found[sighting.plane] = std::max(found[sighting.plane], 1);
  for (const auto& [id, times] : found) editor.edit_plane(id).sightings += times;

  const double needed =
      std::max<double>(options_.confirm_sightings,
                       frame_s > 0.0 ? std::min(options_.confirm_s / frame_s, 1e6) : 0.0);
  std::vector<Id> given_up;
  const auto& key_frames = editor.map().key_frames;
  for (const auto& [id, plane] : editor.map().planes) {
    if (plane.confirmed) continue;
    if (plane.sightings >= needed) {
      editor.edit_plane(id).confirmed = true;
      continue;
    }
    const auto first = plane.observations.empty()
                           ? key_frames.end()
                           : key_frames.find(plane.observations.front().key_frame);
    if (first == key_frames.end() ||
        std::distance(first, key_frames.find(key_frame_id)) >= options_.give_up_key_frames)
      given_up.push_back(id);
  }
  for (const Id id : given_up) editor.remove_plane(id);
}

void PlaneMapper::estimate(MapEditor& editor, Id id) const {
  const Map& map = editor.map();
  const MapPlane& plane = editor.plane(id);
  if (plane.observations.empty()) return;
  // Gauss-Newton on (tilt, tilt, distance), each sighting brought into the world: three steps, as
  // the sightings differ by little.
  PlaneState state = state_of(plane);
  Eigen::Matrix3d covariance = plane.covariance;
  for (int step = 0; step < 3; ++step) {
    Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
    Eigen::Vector3d pull = Eigen::Vector3d::Zero();
    const auto [e0, e1] = plane::tangent_basis(state.normal_world);
    Eigen::Matrix<double, 4, 3> tangents = Eigen::Matrix<double, 4, 3>::Zero();
    tangents.block<3, 1>(0, 0) = e0;
    tangents.block<3, 1>(0, 1) = e1;
    tangents(3, 2) = 1.0;
    for (const auto& observation : plane.observations) {
      const Rigid3d& T = map.key_frames.at(observation.key_frame).T_camera_world;
      const PlaneFactor factor(observe(segment_of(map, observation)), options_.match.noise,
                               "a sighting of plane " + std::to_string(id));
      const PlaneResidual r = plane_residual(factor, T.rotation.toRotationMatrix(), T.translation,
                                             state.normal_world, state.distance_m);
      const Eigen::Matrix3d J = factor.whitener * r.by_plane * tangents;
      const Eigen::Vector3d e = factor.whitener * r.e;
      const double huber = std::sqrt(chi_squared_95(3));
      const double weight = e.norm() > huber ? huber / e.norm() : 1.0;
      information += weight * J.transpose() * J;
      pull -= weight * J.transpose() * e;
    }
    const Eigen::LLT<Eigen::Matrix3d> solved(information);
    if (solved.info() != Eigen::Success) return;
    const Eigen::Vector3d change = solved.solve(pull);
    if (!change.allFinite()) return;
    state.normal_world = (state.normal_world + change[0] * e0 + change[1] * e1).normalized();
    state.distance_m += change[2];
    covariance = solved.solve(Eigen::Matrix3d::Identity());
  }
  MapPlane& out = editor.edit_plane(id);
  out.normal_world = state.normal_world;
  out.distance_m = state.distance_m;
  out.covariance = 0.5 * (covariance + covariance.transpose());
}

void PlaneMapper::rebuild_cloud(MapEditor& editor, Id id) const {
  MapPlane& plane = editor.edit_plane(id);
  plane.cloud_world.clear();
  std::set<Voxel> occupied;
  for (const auto& observation : plane.observations) {
    const auto points = in_world(segment_of(editor.map(), observation).points_camera,
                                 editor.key_frame(observation.key_frame).T_camera_world);
    for (const auto& point : points)
      if (occupied.insert(voxel_of(point, options_.voxel_m)).second)
        plane.cloud_world.push_back(point);
  }
}

/// Side by side in one picture, and not in one plane: two planes, however little they differ.
bool PlaneMapper::seen_apart(const Map& map, const MapPlane& a, const MapPlane& b) const {
  for (const auto& seen_a : a.observations) {
    for (const auto& seen_b : b.observations) {
      if (seen_a.key_frame == seen_b.key_frame &&
          !are_one(segment_of(map, seen_a), segment_of(map, seen_b)))
        return true;
    }
  }
  return false;
}

int PlaneMapper::merge(MapEditor& editor) const {
  const double min_cosine = std::cos(options_.match.max_angle_deg * std::numbers::pi / 180.0);
  int merged = 0;
  const auto find_pair = [&]() -> std::pair<Id, Id> {
    const auto& planes = editor.map().planes;
    for (auto a = planes.begin(); a != planes.end(); ++a) {
      for (auto b = std::next(a); b != planes.end(); ++b) {
        if (a->second.normal_world.dot(b->second.normal_world) < min_cosine) continue;
        // Their distances are compared where they are seen: about the middle of the smaller one.
        const MapPlane& small =
            a->second.cloud_world.size() < b->second.cloud_world.size() ? a->second : b->second;
        const MapPlane& large = &small == &a->second ? b->second : a->second;
        if (small.cloud_world.empty()) continue;
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        for (const auto& point : small.cloud_world) centre += point.cast<double>();
        centre /= static_cast<double>(small.cloud_world.size());
        if (std::abs(large.normal_world.dot(centre) - large.distance_m) >
            options_.match.max_distance_m)
          continue;
        const Rigid3d T_local_world{Eigen::Quaterniond::Identity(), -centre};
        PlaneObservation seen;
        seen.normal_camera = small.normal_world;
        seen.distance_m = small.distance_m - small.normal_world.dot(centre);
        const rgbd::Plane local_plane{small.normal_world, small.distance_m};
        seen.covariance = covariance_in_world(local_plane, small.covariance,
                                              T_local_world.inverse(), Matrix6d::Zero());
        const double distance =
            plane_distance(state_of(large), large.covariance, seen, T_local_world, Matrix6d::Zero(),
                           options_.match.noise);
        if (distance > chi_squared_95(3)) continue;
        if (!near(small.cloud_world, voxels_of(large.cloud_world, options_.max_gap_m),
                  options_.max_gap_m))
          continue;
        if (seen_apart(editor.map(), a->second, b->second)) continue;
        return {b->first, a->first};
      }
    }
    return {kNoId, kNoId};
  };
  for (auto pair = find_pair(); pair.first != kNoId; pair = find_pair()) {
    editor.replace_plane(pair.first, pair.second);
    estimate(editor, pair.second);
    rebuild_cloud(editor, pair.second);
    ++merged;
  }
  return merged;
}

}  // namespace weft::slam
