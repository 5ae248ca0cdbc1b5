#include "evaluation/plane_metrics.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace weft::evaluation {

PlaneSegmentation evaluate_segmentation(const cv::Mat& labels, const cv::Mat& truth,
                                        const cv::Mat& has_depth, double min_iou, int min_px) {
  for (const cv::Mat* image : {&labels, &truth, &has_depth})
    if (image->type() != CV_8UC1 || image->size() != truth.size())
      throw Error("plane segmentation: labels, truth and depth must be 8 bit and of one size");
  if (!(min_iou > 0.5 && min_iou <= 1.0))
    throw Error("plane segmentation: a least IoU of " + std::to_string(min_iou) +
                " is not within 0.5 to 1");
  std::vector<std::array<int, 256>> common(256, std::array<int, 256>{});  // [truth][segment]
  std::array<int, 256> truth_px{}, segment_px{};
  for (int v = 0; v < truth.rows; ++v)
    for (int u = 0; u < truth.cols; ++u) {
      if (has_depth.at<std::uint8_t>(v, u) == 0) continue;
      const int t = truth.at<std::uint8_t>(v, u), s = labels.at<std::uint8_t>(v, u);
      ++common[static_cast<std::size_t>(t)][static_cast<std::size_t>(s)];
      ++truth_px[static_cast<std::size_t>(t)];
      ++segment_px[static_cast<std::size_t>(s)];
    }
  PlaneSegmentation out;
  double area = 0.0;
  for (std::size_t t = 1; t < 256; ++t) {
    if (truth_px[t] == 0 || truth_px[t] < min_px) continue;
    PlaneMatch match;
    match.truth = static_cast<int>(t);
    match.truth_px = truth_px[t];
    for (std::size_t s = 1; s < 256; ++s) {
      const double iou =
          double(common[t][s]) / std::max(1, truth_px[t] + segment_px[s] - common[t][s]);
      if (iou > match.iou) {
        match.iou = iou;
        match.segment = static_cast<int>(s);
      }
    }
    ++out.truths;
    out.matched += match.iou >= min_iou;
    out.mean_iou += match.iou;
    out.area_iou += match.iou * match.truth_px;
    area += match.truth_px;
    out.matches.push_back(match);
  }
  for (std::size_t s = 1; s < 256; ++s) {
    if (segment_px[s] == 0) continue;
    bool on_small = false;
    for (std::size_t t = 1; t < 256; ++t)
      on_small = on_small || (truth_px[t] < min_px && 2 * common[t][s] > segment_px[s]);
    out.segments += !on_small;
  }
  if (out.truths > 0) {
    out.mean_iou /= out.truths;
    out.area_iou /= area;
    out.recall = double(out.matched) / out.truths;
  }
  if (out.segments > 0) out.precision = double(out.matched) / out.segments;
  return out;
}

rgbd::Plane fit_plane(const rgbd::RgbdFrame& frame, const cv::Mat& mask) {
  constexpr double kLeastGate_m = 0.005;
  std::vector<Eigen::Vector3d> points;
  for (int v = 0; v < mask.rows; ++v)
    for (int u = 0; u < mask.cols; ++u)
      if (mask.at<std::uint8_t>(v, u) != 0 && frame.depth.at<std::uint16_t>(v, u) != 0)
        points.push_back(frame.camera.unproject(u, v, frame.depth_m(u, v)));
  rgbd::Plane plane;
  double gate_m = std::numeric_limits<double>::infinity();
  for (int round = 0; round < 3; ++round) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    int used = 0;
    const auto inside = [&](const Eigen::Vector3d& p) {
      return round == 0 || std::abs(plane.height_m(p)) <= gate_m;
    };
    for (const auto& p : points)
      if (inside(p)) {
        sum += p;
        ++used;
      }
    if (used < 3) throw Error("a plane needs three points or more");
    const Eigen::Vector3d centre = sum / used;
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const auto& p : points)
      if (inside(p)) scatter += (p - centre) * (p - centre).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
    Eigen::Vector3d normal = solver.eigenvectors().col(0);
    if (normal.dot(centre) > 0.0) normal = -normal;
    plane.normal = normal;
    plane.distance_m = normal.dot(centre);
    plane.rms_m = std::sqrt(std::max(0.0, solver.eigenvalues()[0]) / used);
    plane.support = used;
    gate_m = std::max(kLeastGate_m, 3.0 * plane.rms_m);
  }
  return plane;
}

}  // namespace weft::evaluation
