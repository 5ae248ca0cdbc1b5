#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "rgbd/surface.hpp"

/// FPFH from its definition: all points of the surface are tried, double precision, libm.
namespace weft::test {

class SlowFpfh {
 public:
  struct Result {
    std::array<double, 33> values{};
    double ties = 0.0;   // so much a value may differ where pairs lie on the edge of two bins
    int pairs = 0;       // of the point itself
    int tied_pairs = 0;  // of its neighbours
  };

  SlowFpfh(const rgbd::Surface& surface, const cv::Mat& normals, double radius_m)
      : points_(surface.points_m),
        normals_(normals),
        radius2_m2_(static_cast<float>(radius_m * radius_m)),
        window_px_(static_cast<int>(radius_m * 4.0 * surface.camera.fx / nearest_m()) + 1) {}

  /// Nothing where the point has no pairs.
  std::optional<Result> at(int x, int y) {
    if (!has(x, y)) return std::nullopt;
    Result result;
    result.pairs = spfh(x, y).pairs;
    std::array<double, 3> totals{};
    double weights = 0.0;
    for (const auto& [u, v] : neighbours(x, y)) {
      const Spfh& each = spfh(u, v);
      if (each.pairs == 0) continue;
      const double weight = 1.0 / (point(u, v) - point(x, y)).squaredNorm();
      weights += weight;
      result.ties += weight * 100.0 * each.ties / each.pairs;
      result.tied_pairs += each.ties;
      for (std::size_t i = 0; i < 33; ++i) {
        result.values[i] += weight * each.counts[i] / each.pairs;
        totals[i / 11] += weight * each.counts[i] / each.pairs;
      }
    }
    if (weights == 0.0) return std::nullopt;
    for (std::size_t i = 0; i < 33; ++i) result.values[i] *= 100.0 / totals[i / 11];
    result.ties /= weights;
    return result;
  }

 private:
  struct Spfh {
    std::array<int, 33> counts{};
    int pairs = 0, ties = 0;
  };
  struct Bins {
    std::array<int, 3> bin{};
    bool defined = false, tie = false;
  };

  double nearest_m() const {
    double nearest = 1e9;
    for (int y = 0; y < points_.rows; ++y)
      for (int x = 0; x < points_.cols; ++x)
        if (points_.at<cv::Vec3f>(y, x)[2] < nearest) nearest = points_.at<cv::Vec3f>(y, x)[2];
    return nearest;
  }
  bool has(int x, int y) const {
    const auto &p = points_.at<cv::Vec3f>(y, x), &n = normals_.at<cv::Vec3f>(y, x);
    return std::isfinite(p[0] + p[1] + p[2]) && std::isfinite(n[0] + n[1] + n[2]);
  }
  Eigen::Vector3d point(int x, int y) const {
    const auto& p = points_.at<cv::Vec3f>(y, x);
    return {p[0], p[1], p[2]};
  }
  Eigen::Vector3d normal(int x, int y) const {
    const auto& n = normals_.at<cv::Vec3f>(y, x);
    return {n[0], n[1], n[2]};
  }

  std::vector<std::pair<int, int>> neighbours(int x, int y) const {
    std::vector<std::pair<int, int>> found;
    for (int v = std::max(0, y - window_px_); v < std::min(points_.rows, y + window_px_ + 1); ++v) {
      for (int u = std::max(0, x - window_px_); u < std::min(points_.cols, x + window_px_ + 1);
           ++u) {
        if ((u == x && v == y) || !has(u, v)) continue;
        // Inside the radius is what single precision puts there, so that there are no ties.
        const cv::Vec3f d = points_.at<cv::Vec3f>(v, u) - points_.at<cv::Vec3f>(y, x);
        if ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2] <= radius2_m2_) found.emplace_back(u, v);
      }
    }
    return found;
  }

  static Bins bins(const Eigen::Vector3d& d, const Eigen::Vector3d& u, const Eigen::Vector3d& n) {
    Bins result;
    const Eigen::Vector3d cross = d.cross(u);
    const double sine = cross.norm() / d.norm();
    const double tolerance = 1e-6 + 1e-6 / sine;
    result.defined = cross.norm() > 1e-10;
    result.tie = sine < 1e-4;
    if (!result.defined) return result;
    const Eigen::Vector3d v = cross.normalized(), w = u.cross(v);
    const std::array<double, 3> share = {(std::atan2(w.dot(n), u.dot(n)) + M_PI) / (2 * M_PI),
                                         (v.dot(n) + 1) / 2, (u.dot(d) / d.norm() + 1) / 2};
    for (std::size_t i = 0; i < 3; ++i) {
      result.bin[i] = std::clamp(static_cast<int>(std::floor(11 * share[i])), 0, 10);
      const double edge = std::round(11 * share[i]);
      // The angle's two ends are one; those of a sine are no edges.
      if (i > 0 && (edge == 0.0 || edge == 11.0)) continue;
      result.tie = result.tie || std::abs(11 * share[i] - edge) < 11 * tolerance;
    }
    return result;
  }

  const Spfh& spfh(int x, int y) {
    const auto known = spfh_.find({x, y});
    if (known != spfh_.end()) return known->second;
    Spfh result;
    for (const auto& [u, v] : neighbours(x, y)) {
      const Eigen::Vector3d d = point(u, v) - point(x, y);
      const Eigen::Vector3d own = normal(x, y), other = normal(u, v);
      const double own_cosine = std::abs(own.dot(d)), other_cosine = std::abs(other.dot(d));
      const Bins from_own = bins(d, own, other), from_other = bins(-d, other, own);
      Bins pair = own_cosine >= other_cosine ? from_own : from_other;
      if (std::abs(own_cosine - other_cosine) < 2e-6 * d.norm() && from_own.bin != from_other.bin)
        pair.tie = true;
      result.ties += pair.tie;
      if (!pair.defined) continue;
      ++result.pairs;
      for (std::size_t i = 0; i < 3; ++i)
        ++result.counts[11 * i + static_cast<std::size_t>(pair.bin[i])];
    }
    return spfh_[{x, y}] = result;
  }

  cv::Mat points_, normals_;
  float radius2_m2_;
  int window_px_;
  std::map<std::pair<int, int>, Spfh> spfh_;
};

}  // namespace weft::test
