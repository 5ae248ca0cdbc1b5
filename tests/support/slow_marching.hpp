#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "descriptor/gdh_options.hpp"
#include "rgbd/surface.hpp"

/// The geodesic-depth histogram from its definition, for tests and benchmarks.
namespace weft::test {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Fast marching, slow and obvious: libm, double precision, no heap; what lies around the latest
/// accepted point is tried anew from all accepted ones.
class SlowMarching {
 public:
  SlowMarching(const rgbd::Surface& surface, int x, int y, int patch_px, double max_mm)
      : surface_(surface) {
    const int first_x = x - patch_px / 2, first_y = y - patch_px / 2;
    patch_ = cv::Rect(first_x, first_y, patch_px, patch_px) &
             cv::Rect(0, 0, surface.points_m.cols, surface.points_m.rows);
    if (!patch_.contains({x, y}) || !finite(at(x, y))) return;
    distances_mm[{x, y}] = 0.0;
    std::map<std::pair<int, int>, double> tried;
    std::pair<int, int> latest = {x, y};
    while (true) {
      for (const auto& next : around(latest))
        if (!distances_mm.contains(next)) tried[next] = through_accepted(next);
      double nearest = kInfinity;
      for (const auto& [point, distance] : tried) {
        if (distance >= nearest) continue;
        nearest = distance;
        latest = point;
      }
      if (!(nearest < max_mm)) return;
      distances_mm[latest] = nearest;
      tried.erase(latest);
    }
  }

  std::map<std::pair<int, int>, double> distances_mm;

 private:
  using Point = std::pair<int, int>;

  static bool finite(const cv::Vec3f& p) {
    return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
  }
  cv::Vec3f at(int x, int y) const { return surface_.points_m.at<cv::Vec3f>(y, x); }
  std::vector<Point> around(Point p) const {
    std::vector<Point> points;
    for (const auto& [dx, dy] :
         {Point{1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}, {-1, -1}, {0, -1}, {1, -1}})
      points.push_back({p.first + dx, p.second + dy});
    return points;
  }
  double edge(Point p, Point q) const {
    if (!patch_.contains({p.first, p.second}) || !patch_.contains({q.first, q.second}))
      return kInfinity;
    const cv::Vec3d a = at(p.first, p.second), b = at(q.first, q.second);
    if (!finite(a) || !finite(b)) return kInfinity;
    if (std::abs(a[2] - b[2]) > rgbd::kDepthJump * std::min(std::abs(a[2]), std::abs(b[2])))
      return kInfinity;
    return 1000.0 * cv::norm(a - b);
  }
  double accepted(Point p) const {
    const auto found = distances_mm.find(p);
    return found == distances_mm.end() ? kInfinity : found->second;
  }
  double through_accepted(Point c) const {
    double best = kInfinity;
    const auto ring = around(c);
    for (std::size_t k = 0; k < 8; ++k) {
      const Point a = ring[k], b = ring[(k + 1) % 8];
      best = std::min(best, accepted(a) + edge(a, c));
      const double t_a = accepted(a), t_b = accepted(b);
      const double ab = edge(a, b), ac = edge(a, c), bc = edge(b, c);
      if (!std::isfinite(t_a + t_b + ab + ac + bc)) continue;
      // Angles in A on both sides of AB, towards C and towards the source.
      const double cos_c = (ab * ab + ac * ac - bc * bc) / (2 * ab * ac);
      const double cos_s = t_a > 0 ? (ab * ab + t_a * t_a - t_b * t_b) / (2 * ab * t_a) : 1.0;
      if (std::abs(cos_c) >= 1.0 || std::abs(cos_s) > 1.0) continue;
      const double angle = std::acos(cos_c) + std::acos(cos_s);
      const double through = std::sqrt(ac * ac + t_a * t_a - 2 * ac * t_a * std::cos(angle));
      // The line from the source to C passes between A and B when the angles there are below 180
      // degrees.
      const double angle_b =
          std::acos(std::clamp((ab * ab + bc * bc - ac * ac) / (2 * ab * bc), -1.0, 1.0)) +
          (t_b > 0 ? std::acos(
                         std::clamp((ab * ab + t_b * t_b - t_a * t_a) / (2 * ab * t_b), -1.0, 1.0))
                   : 0.0);
      if (angle > M_PI || angle_b > M_PI || through < std::max(t_a, t_b)) continue;
      best = std::min(best, through);
    }
    return best;
  }

  const rgbd::Surface& surface_;
  cv::Rect patch_;
};

struct SlowHistogram {
  std::vector<double> values;  // empty: nothing to describe
  bool tie = false;            // a point within rounding of a bin's edge
};

inline SlowHistogram slow_histogram(const rgbd::Surface& surface, int x, int y, int patch_px,
                                    const descriptor::GdhOptions& options) {
  SlowHistogram result;
  const SlowMarching marching(surface, x, y, patch_px, options.geodesic_max_mm);
  if (static_cast<int>(marching.distances_mm.size()) < options.min_points) return result;
  std::vector<std::vector<double>> columns(
      static_cast<std::size_t>(options.geodesic_bins),
      std::vector<double>(static_cast<std::size_t>(options.depth_bins), 0.0));
  const auto near_edge = [](double bin) { return std::abs(bin - std::round(bin)) < 2e-5; };
  const auto depth_m = [&](int px, int py) {
    return double{surface.points_m.at<cv::Vec3f>(py, px)[2]};
  };
  for (const auto& [point, distance_mm] : marching.distances_mm) {
    const double geodesic = distance_mm / options.geodesic_max_mm * options.geodesic_bins;
    const double depth =
        (1000 * (depth_m(point.first, point.second) - depth_m(x, y)) / options.depth_range_mm + 1) /
        2 * options.depth_bins;
    if ((distance_mm > 0 && near_edge(geodesic)) || near_edge(depth)) result.tie = true;
    const int row = std::clamp(static_cast<int>(std::floor(depth)), 0, options.depth_bins - 1);
    columns[static_cast<std::size_t>(geodesic)][static_cast<std::size_t>(row)] += 1;
  }
  double squares = 0;
  for (auto& column : columns) {
    double votes = 0;
    for (const double v : column) votes += v;
    for (double& v : column) {
      v = votes > 0 ? v / votes : 0;
      squares += v * v;
      result.values.push_back(v);
    }
  }
  for (double& v : result.values) v /= std::sqrt(squares);
  return result;
}

}  // namespace weft::test
