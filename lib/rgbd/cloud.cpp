#include "rgbd/cloud.hpp"

#include <cmath>
#include <limits>

#include "base/error.hpp"

namespace weft::rgbd {
namespace {

bool valid(const Eigen::Vector3f& p) {
  return std::isfinite(p.x()) && std::isfinite(p.y()) && std::isfinite(p.z());
}

/// Straight line y = slope x + offset through points given one by one.
struct LineFit {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  void add(double x, double y) {
    n += 1;
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  double spread() const { return n * sxx - sx * sx; }
  double slope() const { return (n * sxy - sx * sy) / spread(); }
  double offset() const { return (sy - slope() * sx) / n; }
};

void check_size(const Cloud& cloud, const std::string& where) {
  if (!cloud.organised()) {
    throw Error(where + ": the cloud is not organised (height " + std::to_string(cloud.height) +
                "); a scan needs one point for each pixel");
  }
  if (cloud.points.size() != static_cast<std::size_t>(cloud.width) * cloud.height) {
    throw Error(where + ": " + std::to_string(cloud.points.size()) + " points for " +
                std::to_string(cloud.width) + "x" + std::to_string(cloud.height) + " px");
  }
}

}  // namespace

CameraFit fit_camera(const Cloud& cloud, const std::string& where) {
  check_size(cloud, where);
  constexpr int kMinPoints = 100;
  LineFit fit_u, fit_v;
  std::size_t i = 0;
  for (int v = 0; v < cloud.height; ++v) {
    for (int u = 0; u < cloud.width; ++u, ++i) {
      const Eigen::Vector3f& p = cloud.points[i];
      if (!valid(p)) continue;
      if (p.z() <= 0.0f) {
        throw Error(where + ": point (" + std::to_string(u) + ", " + std::to_string(v) +
                    ") has z = " + std::to_string(p.z()) + " m, behind the camera");
      }
      fit_u.add(static_cast<double>(p.x()) / p.z(), u);
      fit_v.add(static_cast<double>(p.y()) / p.z(), v);
    }
  }
  if (fit_u.n < kMinPoints) {
    throw Error(where + ": " + std::to_string(static_cast<int>(fit_u.n)) +
                " valid points are too few to recover the camera (" + std::to_string(kMinPoints) +
                " needed)");
  }
  // Rays must differ by a hundredth of a radian or so: less says nothing about the focal length.
  if (!(fit_u.spread() > 1e-5 * fit_u.n * fit_u.n && fit_v.spread() > 1e-5 * fit_v.n * fit_v.n)) {
    throw Error(where + ": the points lie too close to one ray to recover the camera");
  }
  CameraFit fit;
  fit.points = static_cast<int>(fit_u.n);
  fit.camera = {cloud.width,   cloud.height,   fit_u.slope(),
                fit_v.slope(), fit_u.offset(), fit_v.offset()};
  if (fit.camera.fx <= 0.0 || fit.camera.fy <= 0.0) {
    throw Error(where + ": the cloud is mirrored or not in a camera frame (x right, y down, z " +
                "forward): fitted fx=" + std::to_string(fit.camera.fx) +
                " fy=" + std::to_string(fit.camera.fy));
  }
  fit.camera.validate(where);
  i = 0;
  double worst = 0.0;
  for (int v = 0; v < cloud.height; ++v) {
    for (int u = 0; u < cloud.width; ++u, ++i) {
      const Eigen::Vector3f& p = cloud.points[i];
      if (!valid(p)) continue;
      worst = std::max(
          worst, (fit.camera.project(p.cast<double>()) - Eigen::Vector2d(u, v)).squaredNorm());
    }
  }
  fit.max_error_px = std::sqrt(worst);
  return fit;
}

RgbdFrame frame_from_cloud(const Cloud& cloud, const CameraModel& camera, double unit_m,
                           const std::string& where) {
  check_size(cloud, where);
  if (camera.width != cloud.width || camera.height != cloud.height) {
    throw Error(where + ": the cloud has " + std::to_string(cloud.width) + "x" +
                std::to_string(cloud.height) + " points, the camera " +
                std::to_string(camera.width) + "x" + std::to_string(camera.height) + " px");
  }
  RgbdFrame frame;
  frame.camera = camera;
  frame.colour = cloud.colour.clone();
  frame.depth_unit_m = unit_m;
  frame.depth = cv::Mat(cloud.height, cloud.width, CV_16UC1, cv::Scalar(0));
  std::size_t i = 0;
  for (int v = 0; v < cloud.height; ++v) {
    auto* row = frame.depth.ptr<std::uint16_t>(v);
    for (int u = 0; u < cloud.width; ++u, ++i) {
      const Eigen::Vector3f& p = cloud.points[i];
      if (!valid(p)) continue;
      const auto at = [&] {
        return where + ": point (" + std::to_string(u) + ", " + std::to_string(v) + ") ";
      };
      if (p.z() <= 0.0f) throw Error(at() + "lies behind the camera");
      const Eigen::Vector2d px = camera.project(p.cast<double>());
      if (!((px - Eigen::Vector2d(u, v)).cwiseAbs().maxCoeff() <= 0.5)) {
        throw Error(at() + "projects to (" + std::to_string(px.x()) + ", " +
                    std::to_string(px.y()) + "): not a depth image of this camera");
      }
      const double counts = std::round(p.z() / unit_m);
      if (counts > 65535.0) {
        throw Error(at() + "is " + std::to_string(p.z()) + " m away, more than 65535 counts of " +
                    std::to_string(unit_m) + " m");
      }
      row[u] = static_cast<std::uint16_t>(counts);
    }
  }
  return frame;
}

Cloud cloud_from_frame(const RgbdFrame& frame) {
  Cloud cloud;
  cloud.width = frame.depth.cols;
  cloud.height = frame.depth.rows;
  cloud.colour = frame.colour.clone();
  cloud.points.assign(static_cast<std::size_t>(cloud.width) * cloud.height,
                      Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN()));
  std::size_t i = 0;
  for (int v = 0; v < cloud.height; ++v) {
    const auto* row = frame.depth.ptr<std::uint16_t>(v);
    for (int u = 0; u < cloud.width; ++u, ++i) {
      if (row[u] == 0) continue;
      cloud.points[i] = frame.camera.unproject(u, v, row[u] * frame.depth_unit_m).cast<float>();
    }
  }
  return cloud;
}

}  // namespace weft::rgbd
