#include "rgbd/view.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "base/error.hpp"

namespace weft::rgbd {

namespace {

Eigen::Vector2d apply(const Eigen::Matrix3d& homography, const Eigen::Vector2d& px) {
  const Eigen::Vector3d p = homography * px.homogeneous();
  return {p.x() / p.z(), p.y() / p.z()};
}

/// Throws Error unless the table can be looked at from above: 75 degrees of tilt at most.
void check_table(const Plane* table) {
  if (!table) throw Error("the rectified view needs a table plane, and none was found");
  const Eigen::Vector3d& n = table->normal;
  if (!n.allFinite() || std::abs(n.norm() - 1.0) > 1e-6)
    throw Error("the table plane's normal is not of unit length");
  if (!(n.z() <= -0.25))
    throw Error("the table plane is seen too obliquely for the rectified view (normal z " +
                std::to_string(n.z()) + ", at most -0.25)");
  if (!(table->distance_m <= -0.05 && table->distance_m >= -20.0))
    throw Error("the table plane's distance " + std::to_string(table->distance_m) +
                " m is outside -20 to -0.05");
}

void check_images(const RgbdFrame& frame, const cv::Mat& mask) {
  if (mask.type() != CV_8UC1 || mask.cols != frame.camera.width || mask.rows != frame.camera.height)
    throw Error("the garment mask is not 8 bit or not of the frame's size");
}

/// The table's own frame: origin at the camera's nadir, x along the camera's x, y down in the
/// image. Columns: x, y, origin, in the camera frame.
Eigen::Matrix3d table_frame(const Plane& table) {
  const Eigen::Vector3d& n = table.normal;
  const Eigen::Vector3d x = (Eigen::Vector3d::UnitX() - n.x() * n).normalized();
  Eigen::Matrix3d frame;
  frame.col(0) = x;
  frame.col(1) = x.cross(n);
  frame.col(2) = table.distance_m * n;
  return frame;
}

/// Clamped to 0..last; NaN becomes last.
double within(double value, double last) { return std::max(0.0, std::min(last, value)); }

/// Means of 2x2 pixels, rounded; an odd last row or column is dropped.
cv::Mat halve(const cv::Mat& image) {
  cv::Mat half(image.rows / 2, image.cols / 2, CV_8UC3);
  for (int y = 0; y < half.rows; ++y) {
    const std::uint8_t* a = image.ptr(2 * y);
    const std::uint8_t* b = image.ptr(2 * y + 1);
    std::uint8_t* out = half.ptr(y);
    for (int x = 0; x < half.cols; ++x, a += 6, b += 6, out += 3)
      for (int c = 0; c < 3; ++c)
        out[c] = static_cast<std::uint8_t>((a[c] + a[c + 3] + b[c] + b[c + 3] + 2) >> 2);
  }
  return half;
}

}  // namespace

Eigen::Vector2d View::to_sensor(const Eigen::Vector2d& view_px) const {
  return kind == Kind::kSensor ? view_px : apply(sensor_from_view, view_px);
}

Eigen::Vector2d View::to_view(const Eigen::Vector2d& sensor_px) const {
  return kind == Kind::kSensor ? sensor_px : apply(sensor_from_view.inverse(), sensor_px);
}

View make_view(const RgbdFrame& frame, const cv::Mat& mask, const Plane* table,
               const ViewOptions& options) {
  options.validate();
  check_images(frame, mask);
  View view;
  view.sensor = frame.camera;
  view.width = frame.camera.width;
  view.height = frame.camera.height;
  if (!options.rectified) return view;

  check_table(table);
  const Eigen::Matrix3d sensor_from_table = frame.camera.matrix() * table_frame(*table);
  const Eigen::Matrix3d table_from_sensor = sensor_from_table.inverse();

  // Lines stay lines, so the outermost garment pixels of each row bound the garment on the table.
  // Rays that meet the table beyond ten times its distance are near the horizon and left out.
  const double farthest_m = -10.0 * table->distance_m;
  Eigen::Array2d low = Eigen::Array2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Array2d high = -low;
  for (int v = 0; v < mask.rows; ++v) {
    const std::uint8_t* row = mask.ptr(v);
    const std::uint8_t* end = row + mask.cols;
    const std::uint8_t* first = std::find_if(row, end, [](std::uint8_t m) { return m != 0; });
    if (first == end) continue;
    const std::uint8_t* last = end - 1;
    while (*last == 0) --last;
    for (const std::uint8_t* edge : {first, last}) {
      const Eigen::Vector3d p =
          table_from_sensor * Eigen::Vector3d(static_cast<double>(edge - row), v, 1.0);
      if (p.z() <= 0.0) continue;
      const Eigen::Array2d at_m(p.x() / p.z(), p.y() / p.z());
      if (!(at_m.abs().maxCoeff() <= farthest_m)) continue;
      low = low.min(at_m);
      high = high.max(at_m);
    }
  }
  if (!(low <= high).all())
    throw Error("the rectified view needs a garment, and the mask is empty");

  // Whole pixels from the nadir: the grid stays where it is when the mask's edge moves.
  const double scale = options.scale_px_per_m;
  Eigen::Array2i origin_px, size_px;
  for (int i = 0; i < 2; ++i) {
    const int from = static_cast<int>(std::floor((low[i] - options.margin_m) * scale));
    const int to = static_cast<int>(std::ceil((high[i] + options.margin_m) * scale));
    size_px[i] = std::min(to - from + 1, options.max_size_px);
    origin_px[i] = from + (to - from + 1 - size_px[i]) / 2;
  }
  Eigen::Matrix3d table_from_view;
  table_from_view << 1.0 / scale, 0.0, origin_px[0] / scale,  //
      0.0, 1.0 / scale, origin_px[1] / scale,                 //
      0.0, 0.0, 1.0;
  view.kind = View::Kind::kRectified;
  view.width = size_px[0];
  view.height = size_px[1];
  view.sensor_from_view = sensor_from_table * table_from_view;
  view.scale_px_per_m = scale;
  view.table = *table;
  return view;
}

ViewImages render_view(const RgbdFrame& frame, const cv::Mat& mask, const View& view) {
  check_images(frame, mask);
  const bool coloured = !frame.colour.empty();
  if (coloured && (frame.colour.type() != CV_8UC3 || frame.colour.size() != mask.size()))
    throw Error("a view needs 8 bit BGR colour of the camera's size");
  if (!(view.sensor == frame.camera)) throw Error("the view was made for another camera");
  if (view.kind == View::Kind::kSensor) return {frame.colour, mask};
  if (view.width < 1 || view.height < 1) throw Error("the view is empty");

  const int sensor_width = frame.camera.width;
  const int sensor_height = frame.camera.height;
  const Eigen::Matrix3d& h = view.sensor_from_view;

  // Where the sensor is finer than the view, colour is averaged first, so that bilinear
  // interpolation does not skip pixels.
  const Eigen::Vector2d centre(0.5 * view.width, 0.5 * view.height);
  const double ratio =
      (apply(h, centre + Eigen::Vector2d(0.5, 0.0)) - apply(h, centre - Eigen::Vector2d(0.5, 0.0)))
          .norm();
  cv::Mat colour = frame.colour;
  double factor = 1.0;
  while (coloured && ratio * factor >= 2.0 && colour.cols >= 4 && colour.rows >= 4) {
    colour = halve(colour);
    factor *= 0.5;
  }
  const double offset = 0.5 * factor - 0.5;  // of pixel centres in the halved image
  const double last_x = colour.cols - 1, last_y = colour.rows - 1;

  ViewImages images;
  if (coloured) images.colour.create(view.height, view.width, CV_8UC3);
  images.mask.create(view.height, view.width, CV_8UC1);
  std::vector<double> u(static_cast<std::size_t>(view.width)), v(u);
  for (int y = 0; y < view.height; ++y) {
    const double ax = h(0, 1) * y + h(0, 2);
    const double ay = h(1, 1) * y + h(1, 2);
    const double aw = h(2, 1) * y + h(2, 2);
    for (int x = 0; x < view.width; ++x) {
      const double w = h(2, 0) * x + aw;
      u[x] = w > 0.0 ? (h(0, 0) * x + ax) / w : -2.0;
      v[x] = w > 0.0 ? (h(1, 0) * x + ay) / w : -2.0;
    }
    std::uint8_t* colour_out = coloured ? images.colour.ptr(y) : nullptr;
    for (int x = 0; coloured && x < view.width; ++x, colour_out += 3) {
      // Fixed point with 8 fractional bits. Outside the sensor image its border is repeated, so
      // that no edge appears there.
      const int fx = static_cast<int>(within(u[x] * factor + offset, last_x) * 256.0 + 0.5);
      const int fy = static_cast<int>(within(v[x] * factor + offset, last_y) * 256.0 + 0.5);
      const int x0 = fx >> 8, y0 = fy >> 8, wx = fx & 255, wy = fy & 255;
      const std::uint8_t* a = colour.ptr(y0) + 3 * x0;
      const std::uint8_t* b = wy ? a + colour.step[0] : a;
      const int right = wx ? 3 : 0;
      for (int c = 0; c < 3; ++c) {
        const int top = a[c] * (256 - wx) + a[c + right] * wx;
        const int bottom = b[c] * (256 - wx) + b[c + right] * wx;
        colour_out[c] = static_cast<std::uint8_t>((top * (256 - wy) + bottom * wy + 32768) >> 16);
      }
    }
    std::uint8_t* mask_out = images.mask.ptr(y);
    for (int x = 0; x < view.width; ++x) {
      const double ru = std::floor(u[x] + 0.5), rv = std::floor(v[x] + 0.5);
      const bool seen = ru >= 0.0 && ru < sensor_width && rv >= 0.0 && rv < sensor_height;
      mask_out[x] = seen ? mask.at<std::uint8_t>(static_cast<int>(rv), static_cast<int>(ru)) : 0;
    }
  }
  return images;
}

}  // namespace weft::rgbd
