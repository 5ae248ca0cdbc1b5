#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <string>

#include "base/random.hpp"
#include "rgbd/pcd_io.hpp"
#include "rgbd/surface.hpp"

/// Surfaces for tests of descriptors that read them.
namespace weft::test {

inline const cv::Vec3f kNoPoint = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());

/// point_m(x, y) of each pixel.
inline rgbd::Surface surface_of(int width, int height,
                                const std::function<cv::Vec3d(int x, int y)>& point_m) {
  rgbd::Surface surface;
  surface.points_m.create(height, width, CV_32FC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) surface.points_m.at<cv::Vec3f>(y, x) = cv::Vec3f(point_m(x, y));
  }
  return surface;
}

/// Wrinkled cloth 0.8 m away with a fold of 25 mm, noise, and holes where asked for.
inline rgbd::Surface wrinkled(int width, int height, std::uint64_t seed, bool holes) {
  Random random(seed);
  const double focal_px = 525.0;
  rgbd::Surface surface = surface_of(width, height, [&](int x, int y) {
    double z_m = 0.8 + 0.006 * std::sin(0.21 * x + 0.07 * y) +
                 0.004 * std::sin(0.13 * y - 0.05 * x) + 0.0005 * random.normal();
    if (x + 0.3 * y > 0.8 * width) z_m -= 0.025;
    return cv::Vec3d((x - width / 2) / focal_px * z_m, (y - height / 2) / focal_px * z_m, z_m);
  });
  for (int hole = 0; holes && hole < width * height / 300; ++hole) {
    const auto size_x = 1 + static_cast<int>(random.below(5));
    const auto size_y = 1 + static_cast<int>(random.below(5));
    const auto x = static_cast<int>(random.below(static_cast<std::uint64_t>(width)));
    const auto y = static_cast<int>(random.below(static_cast<std::uint64_t>(height)));
    const cv::Rect rect = cv::Rect(x, y, size_x, size_y) & cv::Rect(0, 0, width, height);
    surface.points_m(rect) = cv::Scalar(kNoPoint[0], kNoPoint[0], kNoPoint[0]);
  }
  return surface;
}

/// The points of an organised cloud.
inline rgbd::Surface read_surface(const std::string& pcd) {
  const rgbd::Cloud cloud = rgbd::read_pcd(pcd);
  return surface_of(cloud.width, cloud.height, [&](int x, int y) {
    const auto& p =
        cloud.points[static_cast<std::size_t>(y) * static_cast<std::size_t>(cloud.width) +
                     static_cast<std::size_t>(x)];
    return cv::Vec3d(p.x(), p.y(), p.z());
  });
}

inline cv::Mat full_mask(const rgbd::Surface& surface) {
  return cv::Mat(surface.points_m.size(), CV_8UC1, cv::Scalar(255));
}

}  // namespace weft::test
