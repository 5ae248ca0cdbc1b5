#include "slam/pose_search.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/plane_gate.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr int kLoose_bits = 100, kStrict_bits = 64;  // by which the same feature may differ

Matrix6d diagonal(double sigma_rad, double sigma_m) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(sigma_rad * sigma_rad),
      Eigen::Vector3d::Constant(sigma_m * sigma_m);
  return variances.asDiagonal();
}

Eigen::Vector3d in_camera(const rgbd::CameraModel& camera, const Feature& feature) {
  return camera.unproject(feature.u_px, feature.v_px, feature.depth_m);
}

/// What one pose is optimised against.
struct Evidence {
  std::vector<Eigen::Vector3d> positions_world;
  std::vector<PointObservation> points;
  std::vector<PlaneState> planes_world;
  std::vector<PlaneObservation> planes;
  std::vector<std::size_t> segment_of;  // of each plane observation

  void add(const Eigen::Vector3d& position_world, const Feature& feature,
           const SensorNoise& noise) {
    auto seen = observe(feature, noise);
    seen.point = static_cast<int>(positions_world.size());
    positions_world.push_back(position_world);
    points.push_back(seen);
  }
  /// ids: one a segment; those that are not there (any more) become kNoId.
  void add_planes(std::span<const plane::PlaneSegment> segments, std::vector<Id>& ids,
                  const MapCopy& map) {
    for (std::size_t s = 0; s < ids.size(); ++s) {
      const auto plane = map.plane(ids[s]);
      if (!plane) {
        ids[s] = kNoId;
        continue;
      }
      auto seen = observe(segments[s]);
      seen.plane = static_cast<int>(planes_world.size());
      planes_world.push_back(plane->state);
      planes.push_back(seen);
      segment_of.push_back(s);
    }
  }
  PoseResult optimise(const rgbd::CameraModel& camera, const Rigid3d& start,
                      const PoseOptions& options) const {
    return optimise_pose(camera, start, positions_world, planes_world, points, planes, options);
  }
};

}  // namespace

Matrix6d PoseEstimate::covariance() const {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> modes(information);
  const Vector6d variances = modes.eigenvalues().cwiseMax(1.0).cwiseInverse();
  return modes.eigenvectors() * variances.asDiagonal() * modes.eigenvectors().transpose();
}

PoseSearch::PoseSearch(const TrackerOptions& options, const MapCopy& map)
    : options_(options), map_(map) {}

std::vector<Id> PoseSearch::recognise_planes(const FrameInput& input, const Rigid3d& T_camera_world,
                                             const Matrix6d& covariance) const {
  std::vector<Id> out(input.planes.size(), kNoId);
  if (!options_.use_planes || input.planes.empty()) return out;
  const auto known = map_.planes();
  std::vector<KnownPlane> planes;
  planes.reserve(known.size());
  for (const auto& [id, plane] : known) planes.push_back(plane);
  const auto matches =
      match_planes(input.planes, planes, T_camera_world, covariance, options_.plane_match);
  for (std::size_t s = 0; s < out.size(); ++s)
    if (matches[s] >= 0) out[s] = known[static_cast<std::size_t>(matches[s])].first;
  return out;
}

Rigid3d PoseSearch::keep_what_stands_still(const FrameInput& input, PoseEstimate& estimate) const {
  constexpr std::size_t kProven = 3;
  constexpr double kMaxMiss_sigmas = 6.0;  // of a feature's noise; a young point's own adds to it
  Evidence proven;
  for (std::size_t i = 0; i < estimate.points.size(); ++i) {
    const auto found = map_.map().points.find(estimate.points[i]);
    if (found != map_.map().points.end() && found->second.observations.size() >= kProven)
      proven.add(found->second.position_world, input.features[i], options_.noise);
  }
  if (static_cast<int>(proven.points.size()) < options_.points_to_track)
    return estimate.T_camera_world;
  const auto result = proven.optimise(input.camera, estimate.T_camera_world, options_.pose);
  if (result.point_inliers < options_.points_to_track || result.observed_directions < 6)
    return estimate.T_camera_world;
  for (std::size_t i = 0; i < estimate.points.size(); ++i) {
    const auto point = map_.point(estimate.points[i]);
    if (!point) continue;
    const Feature& feature = input.features[i];
    const Eigen::Vector3d x = result.T_camera_world * point->position_world;
    const double most_px = kMaxMiss_sigmas * options_.noise.pixel_px(feature.level);
    if (x.z() < kMinDepth_m ||
        (input.camera.project(x) - Eigen::Vector2d(feature.u_px, feature.v_px)).norm() > most_px)
      estimate.points[i] = kNoId;
  }
  return result.T_camera_world;
}

void PoseSearch::optimise(const FrameInput& input, PoseEstimate& estimate) const {
  const Rigid3d start = keep_what_stands_still(input, estimate);
  Evidence evidence;
  std::vector<std::size_t> feature_of;
  for (std::size_t i = 0; i < estimate.points.size(); ++i) {
    const auto point = map_.point(estimate.points[i]);
    if (!point) {
      estimate.points[i] = kNoId;
      continue;
    }
    evidence.add(point->position_world, input.features[i], options_.noise);
    feature_of.push_back(i);
  }
  evidence.add_planes(input.planes, estimate.planes, map_);
  const auto result = evidence.optimise(input.camera, start, options_.pose);
  estimate.T_camera_world = result.T_camera_world;
  estimate.information = result.information;
  estimate.observed_directions = result.observed_directions;
  estimate.point_inliers = result.point_inliers;
  estimate.plane_inliers = result.plane_inliers;
  for (std::size_t k = 0; k < feature_of.size(); ++k)
    if (result.point_inlier[k] == 0) estimate.points[feature_of[k]] = kNoId;
  estimate.plane_agrees.assign(estimate.planes.size(), 0);
  constexpr double kApart = 0.05;  // normals 20 degrees from each other, or from a common plane
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (std::size_t k = 0; k < evidence.planes.size(); ++k) {
    estimate.plane_agrees[evidence.segment_of[k]] = result.plane_inlier[k];
    if (result.plane_inlier[k] == 0) continue;
    const auto& n = evidence.planes[k].normal_camera;
    spread += n * n.transpose();
  }
  estimate.plane_directions = static_cast<int>(
      (Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread, Eigen::EigenvaluesOnly)
           .eigenvalues()
           .array() > kApart)
          .count());
}

std::optional<PoseEstimate> PoseSearch::by_motion(const FrameInput& input, const FeatureGrid& grid,
                                                  const PlacedFrame& last, const Rigid3d& predicted,
                                                  double sigma_rad, double sigma_m) const {
  constexpr double kRadius_px = 15.0;
  constexpr int kFew = 20, kLeast = 10;
  const Rigid3d T_world_last = last.T_camera_world.inverse();
  const auto pyramid = this->pyramid();
  std::vector<Sought> sought;
  std::vector<std::size_t> feature_of;
  std::vector<Eigen::Vector3d> positions;
  for (std::size_t i = 0; i < last.points.size(); ++i) {
    const Feature& feature = last.input.features[i];
    Eigen::Vector3d position;
    if (const auto point = map_.point(last.points[i]))
      position = point->position_world;
    else if (feature.depth_m > 0.0f)
      position = T_world_last * in_camera(last.input.camera, feature);
    else
      continue;
    const Eigen::Vector3d point_camera = predicted * position;
    if (point_camera.z() < kMinDepth_m) continue;
    const Eigen::Vector2d pixel = input.camera.project(point_camera);
    if (pixel.x() < 0.0 || pixel.y() < 0.0 || pixel.x() > input.camera.width - 1.0 ||
        pixel.y() > input.camera.height - 1.0)
      continue;
    Sought s;
    s.u_px = static_cast<float>(pixel.x());
    s.v_px = static_cast<float>(pixel.y());
    s.radius_px = static_cast<float>(kRadius_px * std::pow(pyramid.scale, feature.level));
    s.min_level = feature.level - 1;
    s.max_level = feature.level + 1;
    s.descriptor = feature.descriptor;
    sought.push_back(s);
    feature_of.push_back(i);
    positions.push_back(position);
  }
  std::vector<Match> matches;
  for (int attempt = 0; attempt < 2 && static_cast<int>(matches.size()) < kFew; ++attempt) {
    if (attempt > 0)
      for (auto& s : sought) s.radius_px *= 2.0f;
    matches = match_by_place(sought, grid, kLoose_bits, 1.0);
    std::vector<float> turns;
    for (const auto& match : matches) {
      turns.push_back(
          last.input.features[feature_of[static_cast<std::size_t>(match.sought)]].angle_deg -
          input.features[static_cast<std::size_t>(match.feature)].angle_deg);
    }
    keep_common_turn(matches, turns);
  }

  // What the last frame saw without knowing it, by its depth, helps to find the pose where little
  // else does, not more: it may be on something that moves.
  const auto of_map = [&](const Match& match) {
    return last.points[feature_of[static_cast<std::size_t>(match.sought)]] != kNoId;
  };
  if (std::count_if(matches.begin(), matches.end(), of_map) >= 2 * kFew)
    std::erase_if(matches, [&](const Match& match) { return !of_map(match); });
  Evidence evidence;
  for (const auto& match : matches)
    evidence.add(positions[static_cast<std::size_t>(match.sought)],
                 input.features[static_cast<std::size_t>(match.feature)], options_.noise);
  PoseEstimate estimate;
  estimate.points.assign(input.features.size(), kNoId);
  estimate.planes = recognise_planes(input, predicted, diagonal(sigma_rad, sigma_m));
  evidence.add_planes(input.planes, estimate.planes, map_);
  const auto result = evidence.optimise(input.camera, predicted, options_.pose);
  if (result.point_inliers < kLeast && result.plane_inliers < 3) return std::nullopt;
  estimate.T_camera_world = result.T_camera_world;
  estimate.information = result.information;
  estimate.observed_directions = result.observed_directions;
  for (std::size_t k = 0; k < matches.size(); ++k) {
    if (result.point_inlier[k] != 0)
      estimate.points[static_cast<std::size_t>(matches[k].feature)] =
          last.points[feature_of[static_cast<std::size_t>(matches[k].sought)]];
  }
  return estimate;
}

std::optional<PoseEstimate> PoseSearch::by_looks(const FrameInput& input,
                                                 const PoseSource& source) const {
  constexpr double kMaxShift_m = 1.0, kMaxTurn_deg = 45.0, kMaxMiss_sigmas = 15.0;
  constexpr int kLeast = 8;
  const auto matches =
      match_by_looks(source.features, input.features, kStrict_bits, options_.wide_ratio);
  const Rigid3d T_world_source = source.T_camera_world.inverse();
  struct Pair {
    Id id;
    std::size_t feature;
    Eigen::Vector3d position_world;
  };
  std::vector<Pair> known;
  std::vector<PointPair> points;
  for (const auto& match : matches) {
    const auto i = static_cast<std::size_t>(match.sought);
    const auto j = static_cast<std::size_t>(match.feature);
    const Feature& before = source.features[i];
    const Feature& now = input.features[j];
    Pair pair{source.points[i], j, {}};
    if (const auto point = map_.point(pair.id))
      pair.position_world = point->position_world;
    else if (before.depth_m > 0.0f)
      pair.position_world = T_world_source * in_camera(*source.camera, before);
    else
      continue;
    known.push_back(pair);
    if (!(now.depth_m > 0.0f)) continue;
    PointPair in_space;
    in_space.point_a = in_camera(input.camera, now);
    in_space.point_b = source.T_camera_world * pair.position_world;
    const double z = std::max(in_space.point_a.z(), in_space.point_b.z());
    in_space.sigma_m = std::hypot(options_.noise.depth_m(z),
                                  options_.noise.pixel_px(now.level) * z / input.camera.fx);
    points.push_back(in_space);
  }
  std::vector<PlanePair> planes;
  if (options_.use_planes) {
    const double min_cosine = std::cos(kMaxTurn_deg * kDegree);
    for (std::size_t b = 0; b < source.planes.size(); ++b) {
      rgbd::Plane before = source.planes[b].plane;
      if (const auto plane = map_.plane(source.plane_ids[b]))
        before = slam::in_camera(plane->state, source.T_camera_world);
      for (const auto& segment : input.planes) {
        if (segment.plane.normal.dot(before.normal) < min_cosine ||
            std::abs(segment.plane.distance_m - before.distance_m) > kMaxShift_m)
          continue;
        PlanePair pair;
        pair.normal_a = segment.plane.normal;
        pair.distance_a_m = segment.plane.distance_m;
        pair.normal_b = before.normal;
        pair.distance_b_m = before.distance_m;
        const Eigen::Matrix3d covariance =
            with_floors(segment.covariance, options_.plane_match.noise) +
            with_floors(source.planes[b].covariance, options_.plane_match.noise);
        pair.sigma_tilt_rad = std::sqrt(covariance.diagonal().head<2>().maxCoeff());
        pair.sigma_distance_m = std::sqrt(covariance(2, 2));
        planes.push_back(pair);
      }
    }
  }
  const auto motion = ransac_absolute_orientation(points, planes, options_.ransac);
  if (!motion) return std::nullopt;
  PoseEstimate estimate;
  estimate.T_camera_world = motion->T_a_b * source.T_camera_world;
  estimate.points.assign(input.features.size(), kNoId);

  Evidence evidence;
  std::vector<const Pair*> pair_of;
  for (const auto& pair : known) {
    const Eigen::Vector3d point_camera = estimate.T_camera_world * pair.position_world;
    if (point_camera.z() < kMinDepth_m) continue;
    const Feature& feature = input.features[pair.feature];
    const Eigen::Vector2d miss_px =
        input.camera.project(point_camera) - Eigen::Vector2d(feature.u_px, feature.v_px);
    if (miss_px.norm() > kMaxMiss_sigmas * options_.noise.pixel_px(feature.level)) continue;
    evidence.add(pair.position_world, feature, options_.noise);
    pair_of.push_back(&pair);
  }
  estimate.planes = recognise_planes(input, estimate.T_camera_world, diagonal(kDegree, 0.03));
  evidence.add_planes(input.planes, estimate.planes, map_);
  const auto result = evidence.optimise(input.camera, estimate.T_camera_world, options_.pose);
  if (result.point_inliers < kLeast && result.plane_inliers < 3) return std::nullopt;
  estimate.T_camera_world = result.T_camera_world;
  estimate.information = result.information;
  estimate.observed_directions = result.observed_directions;
  estimate.point_inliers = result.point_inliers;
  estimate.plane_inliers = result.plane_inliers;
  for (std::size_t k = 0; k < pair_of.size(); ++k)
    if (result.point_inlier[k] != 0) estimate.points[pair_of[k]->feature] = pair_of[k]->id;
  return estimate;
}

std::vector<LocalPoint> PoseSearch::local(const PoseEstimate& estimate, Id reference) const {
  auto out = local_points(map_.map(), local_key_frames(map_.map(), estimate.points, reference,
                                                       options_.local_key_frames));
  const auto waiting = map_.waiting_points();
  out.insert(out.end(), waiting.begin(), waiting.end());
  return out;
}

void PoseSearch::by_local_map(const FrameInput& input, const FeatureGrid& grid,
                              std::span<const LocalPoint> local, double factor,
                              PoseEstimate& estimate, std::vector<Id>* visible) const {
  constexpr double kRadius_px = 4.0, kRatio = 0.8;
  std::vector<std::uint8_t> taken(input.features.size(), 0);
  std::vector<Id> held;
  for (std::size_t i = 0; i < taken.size(); ++i) {
    if (estimate.points[i] == kNoId) continue;
    taken[i] = 1;
    held.push_back(estimate.points[i]);
  }
  std::sort(held.begin(), held.end());
  std::vector<Sought> sought;
  std::vector<Id> ids;
  for (const auto& point : local) {
    Sought s;
    if (!project(point, input.camera, estimate.T_camera_world, pyramid(), factor * kRadius_px, s))
      continue;
    if (visible != nullptr && point.id >= 0) visible->push_back(point.id);
    if (std::binary_search(held.begin(), held.end(), point.id)) continue;
    sought.push_back(s);
    ids.push_back(point.id);
  }
  for (const auto& match : match_by_place(sought, grid, kLoose_bits, kRatio, taken))
    estimate.points[static_cast<std::size_t>(match.feature)] =
        ids[static_cast<std::size_t>(match.sought)];
  estimate.planes = recognise_planes(input, estimate.T_camera_world, estimate.covariance());
  optimise(input, estimate);
}

Id PoseSearch::reference(const PoseEstimate& estimate) const {
  std::map<Id, int> votes;
  for (const Id id : estimate.points) {
    const auto found = map_.map().points.find(id);
    if (found == map_.map().points.end()) continue;
    for (const auto& observation : found->second.observations) ++votes[observation.key_frame];
  }
  Id best = kNoId;
  int most = 0;
  for (const auto& [id, count] : votes) {
    if (count < most) continue;  // of equals the latest
    best = id;
    most = count;
  }
  return best;
}

std::string PoseSearch::objection(const PoseEstimate& estimate, int least_points) const {
  const int least = estimate.plane_directions >= 3   ? least_points / 5
                    : estimate.plane_directions == 2 ? least_points / 3
                                                     : least_points;
  if (estimate.point_inliers < least) {
    return std::to_string(estimate.point_inliers) + " points and " +
           std::to_string(estimate.plane_inliers) + " planes agree; expected " +
           std::to_string(least) + " points";
  }
  if (estimate.observed_directions < 6)
    return std::to_string(6 - estimate.observed_directions) +
           " directions of motion are not determined";
  const Matrix6d covariance = estimate.covariance();
  const auto sigma = [&](int block) {
    const Eigen::Matrix3d part = covariance.block<3, 3>(3 * block, 3 * block);
    return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(part, Eigen::EigenvaluesOnly)
                         .eigenvalues()[2]);
  };
  if (sigma(0) > options_.max_sigma_deg * kDegree || sigma(1) > options_.max_sigma_m)
    return "the pose is known to " + std::to_string(sigma(0) / kDegree) + " deg and " +
           std::to_string(sigma(1)) + " m only";
  return "";
}

bool PoseSearch::doubtful(const FrameInput& input, const PoseEstimate& estimate) const {
  constexpr int kSeveral = 2;
  const auto large = std::count_if(input.planes.begin(), input.planes.end(), [&](const auto& s) {
    return s.cells >= options_.new_plane_cells;
  });
  return options_.use_planes && large >= kSeveral && estimate.plane_inliers == 0 &&
         static_cast<int>(map_.planes().size()) >= kSeveral &&
         estimate.point_inliers < 2 * options_.points_to_relocalise;
}

}  // namespace weft::slam
