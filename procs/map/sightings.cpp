#include "procs/map/sightings.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>

namespace weft::map_process {
namespace {

using slam::GarmentSighting;
using slam::PartSighting;

/// A piece of the mask as its depth shows it.
struct Piece {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
  int points = 0;
};

Eigen::Matrix3d covariance(const rgbd::CameraModel& camera, const Eigen::Vector3d& point_camera,
                           const SightingOptions& options) {
  return slam::point_covariance(camera, point_camera, options.sigma_px,
                                options.inverse_depth_per_m * point_camera.z() * point_camera.z());
}

/// The cloth at a pixel: the median depth within 4 px, of the same piece. nullopt: none.
std::optional<Eigen::Vector3d> point_at(const rgbd::RgbdFrame& frame, const cv::Mat& labels,
                                        int label, const Eigen::Vector2d& pixel) {
  constexpr int kReach_px = 4;
  const int u = static_cast<int>(std::lround(pixel.x())),
            v = static_cast<int>(std::lround(pixel.y()));
  std::vector<double> depths_m;
  for (int y = std::max(0, v - kReach_px); y <= std::min(labels.rows - 1, v + kReach_px); ++y) {
    for (int x = std::max(0, u - kReach_px); x <= std::min(labels.cols - 1, u + kReach_px); ++x)
      if (labels.at<int>(y, x) == label && frame.depth_m(x, y) > 0.0)
        depths_m.push_back(frame.depth_m(x, y));
  }
  if (depths_m.empty()) return std::nullopt;
  const auto middle = depths_m.begin() + static_cast<std::ptrdiff_t>(depths_m.size() / 2);
  std::nth_element(depths_m.begin(), middle, depths_m.end());
  return frame.camera.unproject(pixel.x(), pixel.y(), *middle);
}

}  // namespace

std::vector<GarmentSighting> sight_garments(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                                            std::span<const detector::Detection> detections,
                                            std::span<const detector::Grasp> grasps,
                                            const SightingOptions& options) {
  cv::Mat labels;
  const int count = cv::connectedComponents(mask, labels, 8, CV_32S);
  std::vector<Piece> pieces(static_cast<std::size_t>(count));
  std::vector<int> in_order;  // labels, as their first pixels lie: OpenCV's own order may differ
  std::vector<std::uint8_t> met(pieces.size(), 0);
  for (int v = 0; v < labels.rows; ++v) {
    for (int u = 0; u < labels.cols; ++u) {
      const int label = labels.at<int>(v, u);
      if (label == 0) continue;
      if (met[static_cast<std::size_t>(label)] == 0) {
        met[static_cast<std::size_t>(label)] = 1;
        in_order.push_back(label);
      }
      const double z_m = frame.depth_m(u, v);
      if (!(z_m > 0.0)) continue;
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
  for (const int label : in_order) {
    const Piece& piece = pieces[static_cast<std::size_t>(label)];
    if (piece.points == 0) continue;
    GarmentSighting garment;
    garment.extent_m = 0.5 * (piece.high - piece.low).maxCoeff();
    if (garment.extent_m < options.least_extent_m || garment.extent_m > options.most_extent_m)
      continue;
    garment.position_camera = piece.sum / piece.points;
    garment.covariance_camera = covariance(frame.camera, garment.position_camera, options);
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
    if (grasp != grasps.end()) {
      part.has_grasp = true;
      part.grasp_score = grasp->score;
      part.position_camera = grasp->point_camera_m;
      part.approach_camera = grasp->approach_camera;
    } else if (const auto point = point_at(frame, labels, label, centre)) {
      part.position_camera = *point;
    } else {
      continue;
    }
    part.covariance_camera = covariance(frame.camera, part.position_camera, options);
    out[garment->second].parts.push_back(std::move(part));
  }
  return out;
}

}  // namespace weft::map_process
