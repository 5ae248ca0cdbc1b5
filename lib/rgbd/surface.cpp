#include "rgbd/surface.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace weft::rgbd {
namespace {

const cv::Vec3f kMissing = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());

/// Missing where single precision cannot tell the point from infinity or from the camera.
cv::Vec3f to_float(const Eigen::Vector3d& p) {
  const cv::Vec3f point(static_cast<float>(p.x()), static_cast<float>(p.y()),
                        static_cast<float>(p.z()));
  return std::isfinite(point[0] + point[1] + point[2]) && point[2] > 0.0f ? point : kMissing;
}

/// Depth in metres at a place between pixels; 0 = missing.
double interpolate_depth_m(const RgbdFrame& frame, double u, double v) {
  const int width = frame.camera.width, height = frame.camera.height;
  if (!(u >= 0.0 && u <= width - 1 && v >= 0.0 && v <= height - 1)) return 0.0;
  const int u0 = static_cast<int>(u), v0 = static_cast<int>(v);
  const int u1 = std::min(u0 + 1, width - 1), v1 = std::min(v0 + 1, height - 1);
  const double a = frame.depth_m(u0, v0), b = frame.depth_m(u1, v0);
  const double c = frame.depth_m(u0, v1), d = frame.depth_m(u1, v1);
  const double nearest = std::min(std::min(a, b), std::min(c, d));
  const double farthest = std::max(std::max(a, b), std::max(c, d));
  if (!(nearest > 0.0) || farthest - nearest > kDepthJump * nearest) return 0.0;
  const double s = u - u0, t = v - v0;
  return (a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t;
}

/// Rows: the view's axes in the camera frame. Views may be turned and mirrored within the table
/// plane, so the axes are those of their pixels, not the camera's.
Eigen::Matrix3d view_from_camera(const View& view) {
  const auto axis = [&](int column) -> Eigen::Vector3d {
    const CameraModel& c = view.sensor;
    const Eigen::Vector3d h = view.sensor_from_view.col(column);
    return Eigen::Vector3d((h.x() - c.cx * h.z()) / c.fx, (h.y() - c.cy * h.z()) / c.fy, h.z())
        .normalized();
  };
  Eigen::Matrix3d rotation;
  rotation << axis(0).transpose(), axis(1).transpose(), -view.table.normal.transpose();
  return rotation;
}

/// The rectified view is what a pinhole at the camera's centre sees that looks along the table's
/// normal; its image plane is the table.
CameraModel rectified_camera(const View& view, const Eigen::Matrix3d& rotation) {
  const Eigen::Matrix3d ray = rotation * view.sensor.matrix().inverse() * view.sensor_from_view;
  return {view.width,
          view.height,
          ray(2, 2) / ray(0, 0),
          ray(2, 2) / ray(1, 1),
          -ray(0, 2) / ray(0, 0),
          -ray(1, 2) / ray(1, 1)};
}

}  // namespace

Surface render_surface(const RgbdFrame& frame, const View& view) {
  if (!(view.sensor == frame.camera)) throw Error("the view was made for another camera");
  if (frame.depth.type() != CV_16UC1 || frame.depth.cols != frame.camera.width ||
      frame.depth.rows != frame.camera.height)
    throw Error("a surface needs 16 bit depth of the camera's size");
  if (view.width < 1 || view.height < 1) throw Error("the view is empty");
  const bool rectified = view.kind == View::Kind::kRectified;
  const Eigen::Matrix3d rotation = rectified ? view_from_camera(view) : Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d& h = view.sensor_from_view;
  Surface surface;
  surface.camera = rectified ? rectified_camera(view, rotation) : frame.camera;
  surface.points_m.create(view.height, view.width, CV_32FC3);
  for (int y = 0; y < view.height; ++y) {
    auto* out = surface.points_m.ptr<cv::Vec3f>(y);
    for (int x = 0; x < view.width; ++x) {
      out[x] = kMissing;
      if (!rectified) {
        const double z_m = frame.depth_m(x, y);
        if (z_m > 0.0) out[x] = to_float(frame.camera.unproject(x, y, z_m));
        continue;
      }
      const double w = h(2, 0) * x + h(2, 1) * y + h(2, 2);
      if (!(w > 0.0)) continue;
      const double u = (h(0, 0) * x + h(0, 1) * y + h(0, 2)) / w;
      const double v = (h(1, 0) * x + h(1, 1) * y + h(1, 2)) / w;
      const double z_m = interpolate_depth_m(frame, u, v);
      if (z_m > 0.0) out[x] = to_float(rotation * frame.camera.unproject(u, v, z_m));
    }
  }
  return surface;
}

}  // namespace weft::rgbd
