#include "procs/map/sightings.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

namespace weft::map_process {
namespace {

using slam::GarmentSighting;
using slam::PartSighting;

constexpr int kReach_px = 4;  // of the pixels that tell a part's depth

/// A piece of the mask as its depth shows it.
struct Piece {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
  int points = 0;
};

/// The cloth round a pixel.
struct Patch {
  double depth_m = 0.0;                                  // median
  Eigen::Vector2d slope_m_px = Eigen::Vector2d::Zero();  // of depth along u and v
};

/// Of the points of a piece within `reach_px`. nullopt: there are none.
std::optional<Patch> patch_at(const rgbd::RgbdFrame& frame, const cv::Mat& labels, int label,
                              const Eigen::Vector2d& pixel, int reach_px) {
  const int u = static_cast<int>(std::lround(pixel.x())),
            v = static_cast<int>(std::lround(pixel.y()));
  std::vector<double> depths_m;
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (int y = std::max(0, v - reach_px); y <= std::min(labels.rows - 1, v + reach_px); ++y) {
    for (int x = std::max(0, u - reach_px); x <= std::min(labels.cols - 1, u + reach_px); ++x) {
      const double z_m = frame.depth_m(x, y);
      if (labels.at<int>(y, x) != label || !(z_m > 0.0)) continue;
      depths_m.push_back(z_m);
      const Eigen::Vector3d row(x - u, y - v, 1.0);
      A += row * row.transpose();
      b += z_m * row;
    }
  }
  if (depths_m.empty()) return std::nullopt;
  Patch out;
  const auto middle = depths_m.begin() + static_cast<std::ptrdiff_t>(depths_m.size() / 2);
  std::nth_element(depths_m.begin(), middle, depths_m.end());
  out.depth_m = *middle;
  const double side = 2.0 * reach_px + 1.0;
  if (static_cast<double>(depths_m.size()) >=
      0.25 * side * side)  // else a line may be all there is
    out.slope_m_px = A.ldlt().solve(b).head<2>();
  return out;
}

}  // namespace

std::vector<GarmentSighting> sight_garments(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                                            std::span<const detector::Detection> detections,
                                            std::span<const detector::Grasp> grasps,
                                            const SightingOptions& options) {
  const auto [labels, count] = foreground::part_mask(frame, mask, options.pieces);
  const double inverse_depth_per_m = options.pieces.inverse_depth_per_m;
  std::vector<Piece> pieces(static_cast<std::size_t>(count) + 1);
  for (int v = 0; v < labels.rows; ++v) {
    for (int u = 0; u < labels.cols; ++u) {
      const int label = labels.at<int>(v, u);
      const double z_m = frame.depth_m(u, v);
      if (label == 0 || !(z_m > 0.0)) continue;
      const Eigen::Vector3d point = frame.camera.unproject(u, v, z_m);
      Piece& piece = pieces[static_cast<std::size_t>(label)];
      piece.sum += point;
      piece.low = piece.low.cwiseMin(point);
      piece.high = piece.high.cwiseMax(point);
      ++piece.points;
    }
  }
  std::vector<GarmentSighting> out;
  std::map<int, std::size_t> garment_of;  // by label
  for (int label = 1; label <= count; ++label) {
    const Piece& piece = pieces[static_cast<std::size_t>(label)];
    if (piece.points == 0) continue;
    GarmentSighting garment;
    garment.extent_m = 0.5 * (piece.high - piece.low).maxCoeff();
    if (garment.extent_m < options.pieces.least_extent_m ||
        garment.extent_m > options.most_extent_m)
      continue;
    garment.position_camera = piece.sum / piece.points;
    const double z_m = garment.position_camera.z();
    garment.covariance_camera = slam::point_covariance(
        frame.camera, garment.position_camera, options.sigma_px, inverse_depth_per_m * z_m * z_m);
    garment_of[label] = out.size();
    out.push_back(std::move(garment));
  }
  for (std::size_t i = 0; i < detections.size(); ++i) {
    const auto& detection = detections[i];
    const Eigen::Vector2d& centre = detection.centre_sensor_px;
    if (detection.probability < options.least_probability || !(centre.x() >= 0.0) ||
        !(centre.y() >= 0.0) || !(centre.x() <= labels.cols - 1.0) ||
        !(centre.y() <= labels.rows - 1.0))
      continue;
    const int label = labels.at<int>(static_cast<int>(std::lround(centre.y())),
                                     static_cast<int>(std::lround(centre.x())));
    const auto garment = garment_of.find(label);
    if (garment == garment_of.end()) continue;
    PartSighting part;
    part.part = detection.part;
    part.probability = detection.probability;
    const auto grasp = std::find_if(grasps.begin(), grasps.end(), [&](const auto& g) {
      return g.detection == static_cast<int>(i) && g.part == detection.part &&
             g.point_camera_m.z() > 0.0;
    });
    part.has_grasp = grasp != grasps.end();
    const Eigen::Vector2d pixel =
        part.has_grasp ? frame.camera.project(grasp->point_camera_m) : centre;
    const auto patch = patch_at(frame, labels, label, pixel, kReach_px);
    if (part.has_grasp) {
      part.grasp_score = grasp->score;
      part.position_camera = grasp->point_camera_m;
      part.approach_camera = grasp->approach_camera;
    } else if (patch) {
      part.position_camera = frame.camera.unproject(pixel.x(), pixel.y(), patch->depth_m);
    } else {
      continue;
    }
    const double z_m = part.position_camera.z();
    const Patch wide =
        patch_at(frame, labels, label, pixel, static_cast<int>(std::lround(options.sigma_px)))
            .value_or(Patch{});
    part.covariance_camera =
        slam::point_covariance(frame.camera, part.position_camera, options.sigma_px,
                               inverse_depth_per_m * z_m * z_m, wide.slope_m_px);
    out[garment->second].parts.push_back(std::move(part));
  }
  return out;
}

}  // namespace weft::map_process
