#include "slam/loop_closer.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "slam/absolute_orientation.hpp"
#include "slam/plane_gate.hpp"

namespace weft::slam {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;
constexpr int kFewShared = 15;  // points: ORB-SLAM2's least weight in its covisibility graph

double angle_rad(const Rigid3d& T) { return log_rotation(T.rotation).norm(); }

Eigen::Vector3d centre(const Rigid3d& T_camera_world) {
  return T_camera_world.inverse().translation;
}

/// The key frame and its neighbours in the covisibility graph, those that share most.
std::set<Id> group_of(const Map& map, Id id, int most) {
  std::set<Id> out{id};
  for (const auto& [other, shared] : neighbours(map, map.key_frames.at(id), kFewShared)) {
    if (static_cast<int>(out.size()) > most) break;
    out.insert(other);
  }
  return out;
}

std::set<Id> points_of(const Map& map, const std::set<Id>& key_frames) {
  std::set<Id> out;
  for (const Id id : key_frames)
    for (const Id point : map.key_frames.at(id).points)
      if (point != kNoId) out.insert(point);
  return out;
}

/// Pairs of large planes that may be the same; most are not.
std::vector<PlanePair> plane_pairs(const KeyFrame& a, const KeyFrame& b) {
  constexpr std::size_t kLargest = 4;
  const PlaneNoise noise;
  std::vector<PlanePair> out;
  for (std::size_t i = 0; i < std::min(kLargest, a.planes.size()); ++i) {
    for (std::size_t j = 0; j < std::min(kLargest, b.planes.size()); ++j) {
      const auto& of_a = a.planes[i].segment.plane;
      const auto& of_b = b.planes[j].segment.plane;
      PlanePair pair{of_a.normal, of_a.distance_m, of_b.normal, of_b.distance_m};
      pair.sigma_tilt_rad = std::numbers::sqrt2 * noise.floor_tilt_deg * kRadiansPerDegree;
      pair.sigma_distance_m = std::numbers::sqrt2 * noise.floor_distance_m;
      out.push_back(pair);
    }
  }
  return out;
}

}  // namespace

LoopCloser::LoopCloser(const LoopOptions& options, const SensorNoise& noise,
                       std::shared_ptr<const BinaryVocabulary> vocabulary)
    : options_(options),
      noise_(noise),
      vocabulary_(std::move(vocabulary)),
      index_(vocabulary_->words()) {
  options_.validate();
}

void LoopCloser::add(const KeyFrame& key_frame) {
  std::vector<Descriptor> descriptors;
  for (const auto& feature : key_frame.features) descriptors.push_back(feature.descriptor);
  index_.add(key_frame.id, vocabulary_->describe(descriptors, 1).bag);
}

void LoopCloser::remove(Id key_frame) { index_.remove(key_frame); }

std::vector<Id> LoopCloser::consistent_candidates(const Map& map, Id id) {
  const BagOfWords& bag = index_.bag(id);
  std::set<Id> connected{id};
  double least_score = 1.0;
  for (const auto& [other, shared] : neighbours(map, map.key_frames.at(id), 1)) {
    connected.insert(other);
    if (shared >= kFewShared)
      least_score = std::min(least_score, similarity(bag, index_.bag(other)));
  }
  std::vector<PlaceCandidate> candidates;
  int most_shared = 0;
  for (const auto& candidate : index_.query(bag)) {
    const auto between =
        std::distance(map.key_frames.find(candidate.place), map.key_frames.find(id));
    if (connected.contains(candidate.place) || between < options_.key_frames_between) continue;
    candidates.push_back(candidate);
    most_shared = std::max(most_shared, candidate.shared_words);
  }
  std::erase_if(candidates, [&](const PlaceCandidate& c) {
    return c.shared_words < options_.min_shared_share * most_shared || c.score < least_score;
  });
  // A place is many key frames: each candidate stands for the best of its group.
  std::map<Id, double> score;
  for (const auto& c : candidates) score[c.place] = c.score;
  struct Accumulated {
    Id best;
    double sum;
  };
  std::vector<Accumulated> accumulated;
  double most = 0.0;
  for (const auto& c : candidates) {
    Accumulated of{c.place, 0.0};
    for (const Id other : group_of(map, c.place, 10)) {
      const auto found = score.find(other);
      if (found == score.end()) continue;
      of.sum += found->second;
      if (found->second > score.at(of.best)) of.best = other;
    }
    accumulated.push_back(of);
    most = std::max(most, of.sum);
  }
  std::stable_sort(accumulated.begin(), accumulated.end(),
                   [](const auto& a, const auto& b) { return a.sum > b.sum; });
  std::vector<Id> out;
  std::vector<Group> now;
  std::set<Id> taken;
  for (const auto& [best, sum] : accumulated) {
    if (sum < 0.75 * most || !taken.insert(best).second) continue;
    Group group{group_of(map, best, 1000000), 0};
    for (const Group& before : groups_) {
      const bool meets = std::any_of(before.key_frames.begin(), before.key_frames.end(),
                                     [&](Id other) { return group.key_frames.contains(other); });
      if (meets) group.consistency = std::max(group.consistency, before.consistency + 1);
    }
    if (group.consistency >= options_.consistent) out.push_back(best);
    now.push_back(std::move(group));
  }
  groups_ = std::move(now);
  return out;
}

std::optional<Loop> LoopCloser::detect(const Map& map, const PointMapper& points, Id id) {
  if (!options_.close) return std::nullopt;
  const auto candidates = consistent_candidates(map, id);
  if (last_loop_ != kNoId && id - last_loop_ < options_.key_frames_between) return std::nullopt;
  std::optional<Loop> best;
  std::vector<Loop> verified;
  for (std::size_t i = 0;
       i < std::min(candidates.size(), static_cast<std::size_t>(options_.candidates)); ++i) {
    if (auto loop = verify(map, points, id, candidates[i])) {
      if (!best || loop->matches > best->matches) best = loop;
      verified.push_back(*loop);
    }
  }
  if (!best) return std::nullopt;
  for (const Loop& other : verified)
    if ((centre(other.T_camera_world) - centre(best->T_camera_world)).norm() >
        options_.max_disagreement_m)
      return std::nullopt;
  if (!plausible(map, *best)) return std::nullopt;
  return best;
}

std::optional<Loop> LoopCloser::verify(const Map& map, const PointMapper& points, Id id,
                                       Id candidate) const {
  const KeyFrame& now = map.key_frames.at(id);
  const KeyFrame& then = map.key_frames.at(candidate);
  // Features that are points of the map, by looks.
  const auto known = [](const KeyFrame& key_frame) {
    std::vector<Feature> features;
    std::vector<Id> ids;
    for (std::size_t i = 0; i < key_frame.features.size(); ++i) {
      if (key_frame.points[i] == kNoId) continue;
      features.push_back(key_frame.features[i]);
      ids.push_back(key_frame.points[i]);
    }
    return std::pair(features, ids);
  };
  const auto [features_now, ids_now] = known(now);
  const auto [features_then, ids_then] = known(then);
  std::vector<PointPair> pairs;
  for (const Match& match : match_by_looks(features_now, features_then, 50, 0.75)) {
    PointPair pair;
    pair.point_a = now.T_camera_world *
                   map.points.at(ids_now[static_cast<std::size_t>(match.sought)]).position_world;
    pair.point_b = then.T_camera_world *
                   map.points.at(ids_then[static_cast<std::size_t>(match.feature)]).position_world;
    const double a = noise_.depth_m(pair.point_a.z()), b = noise_.depth_m(pair.point_b.z());
    pair.sigma_m = std::hypot(a, b);
    pairs.push_back(pair);
  }
  if (static_cast<int>(pairs.size()) < options_.min_matches) return std::nullopt;
  RansacOptions ransac;
  ransac.min_points = options_.min_inliers;
  const auto motion = ransac_absolute_orientation(pairs, plane_pairs(now, then), ransac);
  if (!motion) return std::nullopt;

  // The points around the candidate, seen from there; twice, as the pose gets better.
  Loop loop{id, candidate, motion->T_a_b * then.T_camera_world, 0, 0.0};
  const FeatureGrid grid(now.features, now.camera.width, now.camera.height);
  const auto around = points_of(map, group_of(map, candidate, 20));
  for (const double radius_factor : {3.0, 1.0}) {
    std::vector<Eigen::Vector3d> positions;
    std::vector<PointObservation> seen;
    std::set<int> used;
    for (const Id point : around) {
      const MapPoint& sought = map.points.at(point);
      const int index = points.find(sought, now, grid, loop.T_camera_world, radius_factor);
      if (index < 0 || !used.insert(index).second) continue;
      seen.push_back(observe(now.features[static_cast<std::size_t>(index)], noise_));
      seen.back().point = static_cast<int>(positions.size());
      positions.push_back(sought.position_world);
    }
    const auto refined = optimise_pose(now.camera, loop.T_camera_world, positions, {}, seen, {});
    loop.T_camera_world = refined.T_camera_world;
    loop.matches = refined.point_inliers;
    if (refined.observed_directions < 6 || loop.matches < options_.min_inliers) return std::nullopt;
  }
  if (loop.matches < options_.min_projected) return std::nullopt;
  return loop;
}

/// Whether that much can have gone wrong on the way from the one to the other.
bool LoopCloser::plausible(const Map& map, Loop& loop) const {
  const Rigid3d& T_now = map.key_frames.at(loop.key_frame).T_camera_world;
  loop.moved_m = (centre(loop.T_camera_world) - centre(T_now)).norm();
  const double turned_deg = angle_rad(loop.T_camera_world * T_now.inverse()) / kRadiansPerDegree;
  double way_m = 0.0;
  auto at = map.key_frames.find(loop.partner);
  for (auto next = std::next(at); next != map.key_frames.end(); at = next++)
    way_m += (centre(next->second.T_camera_world) - centre(at->second.T_camera_world)).norm();
  return loop.moved_m <= options_.max_drift_m + options_.max_drift_share * way_m &&
         turned_deg <= options_.max_drift_deg + options_.max_drift_deg_per_m * way_m;
}

bool LoopCloser::close(MapEditor& editor, const PointMapper& points, const PlaneMapper& planes,
                       const Loop& loop) {
  const Map& map = editor.map();
  std::vector<CameraState> cameras;
  std::map<Id, int> place;
  for (const auto& [id, key_frame] : map.key_frames) {
    place[id] = static_cast<int>(cameras.size());
    cameras.push_back({key_frame.T_camera_world, cameras.empty()});
  }
  Matrix6d information = Matrix6d::Zero();
  const double sigma_rad = options_.edge_sigma_deg * kRadiansPerDegree;
  information.diagonal().head<3>().setConstant(1.0 / (sigma_rad * sigma_rad));
  information.diagonal().tail<3>().setConstant(1.0 /
                                               (options_.edge_sigma_m * options_.edge_sigma_m));
  std::vector<RelativePose> edges;
  std::set<std::pair<Id, Id>> tied;
  const auto tie = [&](Id a, Id b) {
    if (a == kNoId || b == kNoId || a == b || !tied.insert(std::minmax(a, b)).second) return;
    edges.push_back(
        {place.at(a), place.at(b),
         map.key_frames.at(a).T_camera_world * map.key_frames.at(b).T_camera_world.inverse(),
         information});
  };
  for (const auto& [id, key_frame] : map.key_frames) {
    tie(id, key_frame.parent);
    for (const Id partner : key_frame.loop_partners) tie(id, partner);
    for (const auto& [other, shared] : neighbours(map, key_frame, options_.strong_covisibility))
      tie(id, other);
  }
  const auto group_now = group_of(map, loop.key_frame, 20);
  edges.push_back({place.at(loop.key_frame), place.at(loop.partner),
                   loop.T_camera_world * map.key_frames.at(loop.partner).T_camera_world.inverse(),
                   information});
  const auto summary = optimise_pose_graph(cameras, edges, options_.graph);
  for (const double strain : summary.chi_squared)
    if (!(strain <= options_.max_strain)) return false;

  // Landmarks go with the key frame that saw them first.
  std::map<Id, Rigid3d> T_new_old;
  for (const auto& [id, key_frame] : map.key_frames)
    T_new_old[id] = cameras[static_cast<std::size_t>(place.at(id))].T_camera_world.inverse() *
                    key_frame.T_camera_world;
  std::vector<Id> point_ids, plane_ids;
  for (const auto& [id, point] : map.points) point_ids.push_back(id);
  for (const auto& [id, plane] : map.planes) plane_ids.push_back(id);
  for (const Id id : point_ids) {
    MapPoint& point = editor.edit_point(id);
    auto with = T_new_old.find(point.first_key_frame);
    if (with == T_new_old.end()) with = T_new_old.find(point.observations.front().key_frame);
    point.position_world = with->second * point.position_world;
  }
  for (const auto& [id, motion] : T_new_old)
    editor.set_pose(id, cameras[static_cast<std::size_t>(place.at(id))].T_camera_world);
  for (const Id id : point_ids) points.refresh(editor, id);
  for (const Id id : plane_ids) {
    planes.estimate(editor, id);
    planes.rebuild_cloud(editor, id);
  }

  // What both ends see is one.
  const auto then = points_of(map, group_of(map, loop.partner, 20));
  const std::vector<Id> around(then.begin(), then.end());
  for (const Id id : group_now) points.fuse(editor, id, around, 4.0 / 3.0);
  planes.merge(editor);
  editor.tie(loop.key_frame, loop.partner);
  last_loop_ = loop.key_frame;
  groups_.clear();
  return true;
}

}  // namespace weft::slam
