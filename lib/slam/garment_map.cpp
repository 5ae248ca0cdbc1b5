#include "slam/garment_map.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "base/error.hpp"
#include "slam/assignment.hpp"

namespace weft::slam {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

void check_position(const Eigen::Vector3d& position, const Eigen::Matrix3d& covariance,
                    const std::string& where) {
  const bool symmetric = covariance.allFinite() &&
                         (covariance - covariance.transpose()).isZero(1e-9 * covariance.norm());
  if (!position.allFinite() || position.norm() > 1e6 || !symmetric ||
      covariance.llt().info() != Eigen::Success)
    throw Error(where + ": a position is not finite or its covariance not positive definite");
}

void check_share(double value, const char* what, const std::string& where) {
  if (!(value >= 0.0 && value <= 1.0))
    throw Error(where + ": a " + what + " of " + std::to_string(value) + "; expected 0 to 1");
}

void check_extent(double extent_m, const std::string& where) {
  if (!(extent_m >= 0.0 && extent_m <= 100.0))
    throw Error(where + ": an extent of " + std::to_string(extent_m) + " m; expected 0 to 100");
}

void check_direction(const Eigen::Vector3d& direction, const std::string& where) {
  if (!(std::abs(direction.norm() - 1.0) < 1e-3))
    throw Error(where + ": the approach is not of unit length");
}

double chi_squared(const Eigen::Vector3d& difference, const Eigen::Matrix3d& covariance) {
  return covariance.llt().matrixL().solve(difference).squaredNorm();
}

/// The mean of two Gaussians' product.
void fuse(Eigen::Vector3d& mean, Eigen::Matrix3d& covariance, const Eigen::Vector3d& other,
          const Eigen::Matrix3d& other_covariance) {
  const Eigen::Matrix3d gain =
      covariance * (covariance + other_covariance).llt().solve(Eigen::Matrix3d::Identity());
  mean += gain * (other - mean);
  covariance -= gain * covariance;
  covariance = (0.5 * (covariance + covariance.transpose())).eval();
}

/// What many views of one camera cannot average away.
Eigen::Matrix3d with_floor(const Eigen::Matrix3d& covariance, double sigma_m) {
  return covariance + 0.01 * sigma_m * sigma_m * Eigen::Matrix3d::Identity();
}

}  // namespace

Eigen::Matrix3d point_covariance(const rgbd::CameraModel& camera,
                                 const Eigen::Vector3d& point_camera, double sigma_px,
                                 double sigma_depth_m, const Eigen::Vector2d& slope_m_px) {
  // x = (u - cx) z / fx, likewise y.
  const Eigen::Vector3d ray = point_camera / point_camera.z();
  Eigen::Matrix3d J;
  J.col(0) =
      sigma_px * (point_camera.z() / camera.fx * Eigen::Vector3d::UnitX() + slope_m_px.x() * ray);
  J.col(1) =
      sigma_px * (point_camera.z() / camera.fy * Eigen::Vector3d::UnitY() + slope_m_px.y() * ray);
  J.col(2) = sigma_depth_m * ray;
  return J * J.transpose();
}

struct GarmentMap::SeenInWorld {
  Eigen::Vector3d position;
  Eigen::Matrix3d covariance;
  double extent_m;
  std::vector<GarmentPart> parts;
};

GarmentMap::GarmentMap(const GarmentMapOptions& options) : options_(options) {
  options_.validate();
}

void check_garments(const SavedGarments& saved) {
  Id last = -1;
  for (const auto& garment : saved.garments) {
    const std::string where = "garment " + std::to_string(garment.id);
    if (garment.id <= last || garment.id >= saved.next_id)
      throw Error(where + ": ids are not in order, or not below " + std::to_string(saved.next_id));
    last = garment.id;
    check_position(garment.position_world, garment.covariance, where);
    check_extent(garment.extent_m, where);
    for (const auto& part : garment.parts) {
      check_position(part.position_world, part.covariance, where + ", " + part.part);
      check_share(part.probability, "probability", where + ", " + part.part);
      check_share(part.grasp_score, "grasp score", where + ", " + part.part);
      check_direction(part.approach_world, where + ", " + part.part);
    }
  }
}

GarmentMap::GarmentMap(const GarmentMapOptions& options, SavedGarments saved)
    : GarmentMap(options) {
  check_garments(saved);
  garments_ = std::move(saved.garments);
  next_id_ = saved.next_id;
  // It may have been saved with a smaller one.
  const Eigen::Matrix3d bias =
      options_.part_bias_m * options_.part_bias_m * Eigen::Matrix3d::Identity();
  for (auto& garment : garments_)
    for (auto& part : garment.parts)
      if ((part.covariance - bias).llt().info() != Eigen::Success) part.covariance += bias;
}

void GarmentMap::add(const Map& map, const GarmentView& view,
                     std::span<const GarmentSighting> sightings) {
  const auto found = map.key_frames.find(view.key_frame);
  if (found == map.key_frames.end())
    throw Error("garments: there is no key frame " + std::to_string(view.key_frame) +
                " in the map");
  const KeyFrame& key_frame = found->second;
  const Rigid3d T_camera_world = view.T_camera_key_frame * key_frame.T_camera_world;
  const Rigid3d T_world_camera = T_camera_world.inverse();
  const Eigen::Matrix3d R = T_world_camera.rotation.toRotationMatrix();
  std::vector<SeenInWorld> seen;
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const auto& sighting = sightings[i];
    const std::string where = "garment sighting " + std::to_string(i);
    check_position(sighting.position_camera, sighting.covariance_camera, where);
    check_extent(sighting.extent_m, where);
    const auto noise = [](double sigma_m) -> Eigen::Matrix3d {
      return sigma_m * sigma_m * Eigen::Matrix3d::Identity();
    };
    SeenInWorld out{T_world_camera * sighting.position_camera,
                    R * sighting.covariance_camera * R.transpose() + noise(options_.centre_sigma_m),
                    sighting.extent_m,
                    {}};
    for (const auto& part : sighting.parts) {
      check_position(part.position_camera, part.covariance_camera, where + ", " + part.part);
      check_share(part.probability, "probability", where + ", " + part.part);
      check_share(part.grasp_score, "grasp score", where + ", " + part.part);
      if (part.has_grasp) check_direction(part.approach_camera, where + ", " + part.part);
      GarmentPart to;
      to.part = part.part;
      to.position_world = T_world_camera * part.position_camera;
      to.covariance = R * part.covariance_camera * R.transpose() + noise(options_.part_sigma_m);
      to.probability = part.probability;
      to.has_grasp = part.has_grasp;
      to.grasp_score = part.grasp_score;
      to.approach_world = R * part.approach_camera;
      out.parts.push_back(std::move(to));
    }
    seen.push_back(std::move(out));
  }
  follow(map);

  Eigen::MatrixXd costs =
      Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(seen.size()),
                                static_cast<Eigen::Index>(garments_.size()), kInfinity);
  for (std::size_t s = 0; s < seen.size(); ++s) {
    for (std::size_t g = 0; g < garments_.size(); ++g) {
      const double cost = chi_squared(seen[s].position - garments_[g].position_world,
                                      seen[s].covariance + garments_[g].covariance);
      if (cost <= options_.max_chi_squared)
        costs(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(g)) = cost;
    }
  }
  const auto garment_of = assign(costs, options_.max_chi_squared);
  std::vector<char> was_seen(garments_.size(), 0);
  for (std::size_t s = 0; s < seen.size(); ++s) {
    if (garment_of[s] < 0) {
      if (options_.needs_part && seen[s].parts.empty()) continue;
      Garment fresh;
      fresh.id = next_id_++;
      fresh.position_world = seen[s].position;
      fresh.covariance = seen[s].covariance;
      garments_.push_back(std::move(fresh));
      was_seen.push_back(1);
      merge_parts(garments_.back(), seen[s]);
    } else {
      const auto g = static_cast<std::size_t>(garment_of[s]);
      was_seen[g] = 1;
      merge(garments_[g], seen[s]);
    }
    Garment& garment =
        garment_of[s] < 0 ? garments_.back() : garments_[static_cast<std::size_t>(garment_of[s])];
    garment.extent_m = std::max(garment.extent_m, seen[s].extent_m);
    ++garment.sightings;
    ++garment.consecutive;
    garment.missed = 0;
    garment.in_map = garment.in_map || garment.consecutive >= options_.views_to_appear;
    garment.supporting_plane = supporting_plane(map, garment.position_world);
    garment.anchor = view.key_frame;
    garment.position_anchor = key_frame.T_camera_world * garment.position_world;
    for (auto& part : garment.parts)
      part.position_anchor = key_frame.T_camera_world * part.position_world;
  }
  for (std::size_t g = 0; g < garments_.size(); ++g) {
    if (was_seen[g] || !should_be_seen(garments_[g], key_frame.camera, T_camera_world)) continue;
    garments_[g].consecutive = 0;
    ++garments_[g].missed;
  }
  std::erase_if(garments_, [&](const Garment& garment) {
    return garment.missed >= (garment.in_map ? options_.views_to_disappear : 1);
  });
}

void GarmentMap::merge(Garment& garment, const SeenInWorld& seen) const {
  fuse(garment.position_world, garment.covariance, seen.position, seen.covariance);
  garment.covariance = with_floor(garment.covariance, options_.centre_sigma_m);
  merge_parts(garment, seen);
}

void GarmentMap::merge_parts(Garment& garment, const SeenInWorld& seen) const {
  // Two views have it in common, so their difference has none of it.
  const Eigen::Matrix3d bias =
      options_.part_bias_m * options_.part_bias_m * Eigen::Matrix3d::Identity();
  Eigen::MatrixXd costs =
      Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(seen.parts.size()),
                                static_cast<Eigen::Index>(garment.parts.size()), kInfinity);
  for (std::size_t s = 0; s < seen.parts.size(); ++s) {
    for (std::size_t p = 0; p < garment.parts.size(); ++p) {
      if (seen.parts[s].part != garment.parts[p].part) continue;
      const double cost =
          chi_squared(seen.parts[s].position_world - garment.parts[p].position_world,
                      seen.parts[s].covariance + garment.parts[p].covariance - bias);
      if (cost <= options_.max_chi_squared)
        costs(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(p)) = cost;
    }
  }
  const auto part_of = assign(costs, options_.max_chi_squared);
  for (auto& part : garment.parts) part.probability *= options_.memory;
  std::vector<char> was_seen(garment.parts.size(), 0);
  for (std::size_t s = 0; s < seen.parts.size(); ++s) {
    const GarmentPart& now = seen.parts[s];
    if (part_of[s] < 0) {
      garment.parts.push_back(now);
      garment.parts.back().covariance += bias;
      garment.parts.back().probability *= 1.0 - options_.memory;
      garment.parts.back().sightings = 1;
      was_seen.push_back(1);
      continue;
    }
    GarmentPart& part = garment.parts[static_cast<std::size_t>(part_of[s])];
    was_seen[static_cast<std::size_t>(part_of[s])] = 1;
    part.covariance -= bias;
    fuse(part.position_world, part.covariance, now.position_world, now.covariance);
    part.covariance = with_floor(part.covariance, options_.part_sigma_m) + bias;
    part.probability += (1.0 - options_.memory) * now.probability;
    ++part.sightings;
    if (now.has_grasp) {
      part.has_grasp = true;
      part.grasp_score = now.grasp_score;
      part.approach_world = now.approach_world;
    }
  }
  std::size_t at = 0;
  std::erase_if(garment.parts, [&](const GarmentPart& part) {
    return !was_seen[at++] && part.probability < options_.min_probability;
  });
}

void GarmentMap::follow(const Map& map) {
  for (auto& garment : garments_) {
    auto anchor = map.key_frames.find(garment.anchor);
    if (anchor == map.key_frames.end()) {
      // It went: the next older one holds it where it is, or the oldest.
      if (map.key_frames.empty()) continue;
      anchor = map.key_frames.upper_bound(garment.anchor);
      if (anchor != map.key_frames.begin()) --anchor;
      garment.anchor = anchor->first;
      garment.position_anchor = anchor->second.T_camera_world * garment.position_world;
      for (auto& part : garment.parts)
        part.position_anchor = anchor->second.T_camera_world * part.position_world;
      continue;
    }
    const Rigid3d T_world_anchor = anchor->second.T_camera_world.inverse();
    garment.position_world = T_world_anchor * garment.position_anchor;
    for (auto& part : garment.parts) part.position_world = T_world_anchor * part.position_anchor;
    if (!map.planes.contains(garment.supporting_plane)) garment.supporting_plane = kNoId;
  }
}

bool GarmentMap::should_be_seen(const Garment& garment, const rgbd::CameraModel& camera,
                                const Rigid3d& T_camera_world) const {
  const Eigen::Vector3d x = T_camera_world * garment.position_world;
  if (!(x.z() > 0.0 && x.norm() <= options_.max_range_m)) return false;
  const Eigen::Vector2d pixel = camera.project(x);
  return pixel.x() >= options_.margin_px && pixel.y() >= options_.margin_px &&
         pixel.x() <= camera.width - 1 - options_.margin_px &&
         pixel.y() <= camera.height - 1 - options_.margin_px;
}

Id GarmentMap::supporting_plane(const Map& map, const Eigen::Vector3d& position_world) const {
  Id best = kNoId;
  // A confirmed plane rather than one that is not yet; of these the largest, or a folded garment
  // would lie on its own upper side.
  std::pair<bool, std::size_t> most{false, 0};
  for (const auto& [id, plane] : map.planes) {
    const std::pair<bool, std::size_t> size{plane.confirmed, plane.cloud_world.size()};
    const double height = plane.normal_world.dot(position_world) - plane.distance_m;
    // A little below: the middle of what lies flat is as uncertain as the plane.
    if (size <= most || height < -0.03 || height > options_.max_height_m) continue;
    const Eigen::Vector3d foot = position_world - height * plane.normal_world;
    const bool reaches =
        std::any_of(plane.cloud_world.begin(), plane.cloud_world.end(), [&](const auto& point) {
          return (point.template cast<double>() - foot).norm() <= options_.plane_reach_m;
        });
    if (!reaches) continue;
    best = id;
    most = size;
  }
  return best;
}

}  // namespace weft::slam
