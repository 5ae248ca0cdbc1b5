#include "foreground/table.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <vector>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::foreground {

namespace {

/// A pixel with depth. In (x, y, 1/z) planes are linear and the noise of structured light is the
/// same everywhere.
struct Sample {
  double x, y;  // pixel in units of the focal length, from the principal point
  double z_m, inverse_z;
  bool border;  // among the outermost of its row or column
};

/// At most about 80 samples a row, on a regular grid.
std::vector<Sample> sample(const rgbd::RgbdFrame& frame, const cv::Mat& exclude) {
  const auto& camera = frame.camera;
  if (frame.depth.type() != CV_16UC1 || frame.depth.cols != camera.width ||
      frame.depth.rows != camera.height)
    throw Error("the depth image is not 16 bit or not of the camera's size");
  if (!exclude.empty() && (exclude.type() != CV_8UC1 || exclude.size() != frame.depth.size()))
    throw Error("the mask of excluded pixels is not 8 bit or not of the frame's size");
  const int step = std::max(1, std::max(camera.width, camera.height) / 80);
  const int columns = (camera.width - 1 - step / 2) / step + 1;
  const int rows = (camera.height - 1 - step / 2) / step + 1;
  std::vector<int> index(static_cast<std::size_t>(columns) * rows, -1);
  std::vector<Sample> samples;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const int u = c * step + step / 2, v = r * step + step / 2;
      const double z_m = frame.depth_m(u, v);
      if (!(z_m > 0.0) || (!exclude.empty() && exclude.at<std::uint8_t>(v, u))) continue;
      index[static_cast<std::size_t>(r) * columns + c] = static_cast<int>(samples.size());
      samples.push_back(
          {(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, z_m, 1.0 / z_m, false});
    }
  }
  const auto mark_ends = [&](int begin, int stride, int count) {
    for (int direction : {1, -1}) {
      int found = 0;
      for (int k = 0; k < count && found < 3; ++k) {
        const int i = index[begin + (direction > 0 ? k : count - 1 - k) * stride];
        if (i >= 0) {
          samples[i].border = true;
          ++found;
        }
      }
    }
  };
  for (int r = 0; r < rows; ++r) mark_ends(r * columns, 1, columns);
  for (int c = 0; c < columns; ++c) mark_ends(c, columns, rows);
  return samples;
}

/// 1/z = a x + b y + c; the plane through the camera's centre has none.
struct InversePlane {
  double a, b, c;
  double norm() const { return std::sqrt(a * a + b * b + c * c); }
  /// Height of a sample above the plane, towards the camera.
  double height_m(const Sample& s, double inverse_norm) const {
    return (1.0 - (a * s.x + b * s.y + c) * s.z_m) * inverse_norm;
  }
};

double tolerance(const Sample& s) { return std::max(1.0, s.z_m * s.z_m); }

rgbd::Plane to_plane(const InversePlane& p) {
  // a x + b y + c = 1/z, so (a, b, c) . point = 1.
  rgbd::Plane plane;
  const double inverse_norm = 1.0 / p.norm();
  plane.normal = -Eigen::Vector3d(p.a, p.b, p.c) * inverse_norm;
  plane.distance_m = -inverse_norm;
  return plane;
}

InversePlane from_plane(const rgbd::Plane& plane) {
  const Eigen::Vector3d p = plane.normal / plane.distance_m;
  return {p.x(), p.y(), p.z()};
}

/// Least squares over the samples within reach_m, three times over; sets rms and support. Returns
/// nothing when fewer than 50 samples are within reach.
std::optional<rgbd::Plane> refine(const std::vector<Sample>& samples, InversePlane plane,
                                  double reach_m) {
  rgbd::Plane result;
  for (int iteration = 0; iteration < 4; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    const double inverse_norm = 1.0 / plane.norm();
    double squares = 0.0;
    int support = 0;
    for (const Sample& s : samples) {
      const double h = plane.height_m(s, inverse_norm);
      if (!(std::abs(h) <= reach_m * tolerance(s))) continue;
      const Eigen::Vector3d row(s.x, s.y, 1.0);
      normal += row * row.transpose();
      right += row * s.inverse_z;
      squares += h * h;
      ++support;
    }
    if (support < 50) return std::nullopt;
    if (iteration == 3) {
      result = to_plane(plane);
      result.rms_m = std::sqrt(squares / support);
      result.support = support;
      break;
    }
    const Eigen::Vector3d p = normal.ldlt().solve(right);
    if (!p.allFinite() || !(p.squaredNorm() > 1e-6)) return std::nullopt;
    plane = {p.x(), p.y(), p.z()};
  }
  return result;
}

}  // namespace

std::optional<rgbd::Plane> find_table(const rgbd::RgbdFrame& frame, const cv::Mat& exclude,
                                      const TableOptions& options) {
  options.validate();
  const std::vector<Sample> samples = sample(frame, exclude);
  if (samples.size() < 100) return std::nullopt;
  std::vector<Sample> judges;  // a third of the samples tells good planes from bad ones
  for (std::size_t i = 0; i < samples.size(); i += 3) judges.push_back(samples[i]);
  const auto count = static_cast<double>(judges.size());
  const auto border =
      std::max(1.0, static_cast<double>(std::count_if(judges.begin(), judges.end(),
                                                      [](const Sample& s) { return s.border; })));
  const int max_behind = static_cast<int>(options.max_behind_share * count);
  const double min_area =
      0.01 * frame.camera.width / frame.camera.fx * frame.camera.height / frame.camera.fy;
  // cos of the largest tilt without libm: cos(t) by its series is exact enough for a limit.
  const double tilt = options.max_tilt_deg * 0.017453292519943295, t2 = tilt * tilt;
  const double min_cos = 1.0 - t2 / 2.0 + t2 * t2 / 24.0 - t2 * t2 * t2 / 720.0;

  Random random(static_cast<std::uint64_t>(options.seed));
  const auto best_plane = [&](const std::vector<Sample>& points, double border_weight) {
    std::optional<InversePlane> best;
    double best_score = -1.0;
    for (int k = 0; k < options.hypotheses; ++k) {
      const Sample& p = points[random.below(points.size())];
      const Sample& q = points[random.below(points.size())];
      const Sample& r = points[random.below(points.size())];
      const double qx = q.x - p.x, qy = q.y - p.y, qw = q.inverse_z - p.inverse_z;
      const double rx = r.x - p.x, ry = r.y - p.y, rw = r.inverse_z - p.inverse_z;
      const double area = qx * ry - qy * rx;
      if (!(std::abs(area) > min_area)) continue;  // too near to each other to carry a plane
      InversePlane plane;
      plane.a = (qw * ry - qy * rw) / area;
      plane.b = (qx * rw - qw * rx) / area;
      plane.c = p.inverse_z - plane.a * p.x - plane.b * p.y;
      const double inverse_norm = 1.0 / plane.norm();
      if (!(plane.c * inverse_norm >= min_cos)) continue;
      int inside = 0, inside_border = 0, behind = 0;
      for (const Sample& s : judges) {
        const double h = plane.height_m(s, inverse_norm), scale = tolerance(s);
        if (h < -options.behind_m * scale) {
          if (h > -options.other_surface_m && ++behind > max_behind) break;
        } else if (std::abs(h) <= options.inlier_m * scale) {
          ++inside;
          inside_border += s.border;
        }
      }
      if (behind > max_behind || inside < options.min_share * count) continue;
      const double score = inside / count + border_weight * inside_border / border;
      if (score > best_score) {
        best_score = score;
        best = plane;
      }
    }
    return best;
  };
  std::optional<InversePlane> best = best_plane(samples, 1.0);
  for (int level = 0; best && level < 3; ++level) {
    std::vector<Sample> before;
    const double inverse_norm = 1.0 / best->norm();
    std::copy_if(samples.begin(), samples.end(), std::back_inserter(before), [&](const Sample& s) {
      return best->height_m(s, inverse_norm) > options.other_surface_m;
    });
    if (static_cast<double>(before.size()) <
        options.min_share * static_cast<double>(samples.size()))
      break;
    const auto higher = best_plane(before, 0.0);
    if (!higher) break;
    best = higher;
  }
  if (!best) return std::nullopt;
  return refine(samples, *best, options.inlier_m);
}

rgbd::Plane refine_plane(const rgbd::RgbdFrame& frame, const cv::Mat& exclude,
                         const rgbd::Plane& plane) {
  return refine(sample(frame, exclude), from_plane(plane), 0.02).value_or(plane);
}

TableSurface::TableSurface(const rgbd::CameraModel& camera, const rgbd::Plane& plane)
    : camera_(camera), plane_(plane) {
  if (!(plane.distance_m < 0.0)) throw Error("the table plane does not face the camera");
  const InversePlane p = from_plane(plane);
  c_[0] = p.c;
  c_[1] = p.a;
  c_[2] = p.b;
}

TableSurface fit_surface(const rgbd::RgbdFrame& frame, const cv::Mat& exclude,
                         const rgbd::Plane& plane, int degree) {
  using Vector10 = Eigen::Matrix<double, 10, 1>;
  using Matrix10 = Eigen::Matrix<double, 10, 10>;
  TableSurface surface(frame.camera, plane);
  const std::vector<Sample> samples = sample(frame, exclude);
  const double sigma_m = 0.004;
  // A weak prior on the curvature (10 mm at the corners, noise correlated over about 50 samples):
  // where only one side of the table is seen, the surface must not bend freely.
  const double ridge = 50.0 * (sigma_m / 0.020) * (sigma_m / 0.020);
  for (int iteration = 0; iteration < 8; ++iteration) {
    Matrix10 normal = Matrix10::Zero();
    Vector10 right = Vector10::Zero();
    for (const Sample& s : samples) {
      const double scale = tolerance(s);
      const double h = surface.height_m(s.x * frame.camera.fx + frame.camera.cx,
                                        s.y * frame.camera.fy + frame.camera.cy, s.z_m) /
                       (sigma_m * scale);
      const double t = h > 0.0 || !exclude.empty() ? h : 0.5 * h;
      if (std::abs(t) > 6.0) continue;
      const double weight = 1.0 / ((1.0 + t * t) * (1.0 + t * t));
      const double xx = s.x * s.x, yy = s.y * s.y;
      const double row[10] = {1.0, s.x,      s.y,      xx,       s.x * s.y,
                              yy,  xx * s.x, xx * s.y, yy * s.x, yy * s.y};
      double weighted[10];
      for (int i = 0; i < 10; ++i) weighted[i] = weight * row[i];
      // The lower half is all that ldlt() looks at.
      for (int j = 0; j < 10; ++j) {
        for (int i = j; i < 10; ++i) normal(i, j) += weighted[i] * row[j];
        right[j] += weight * s.inverse_z * row[j];
      }
    }
    for (int i = 3; i < 6; ++i) normal(i, i) += ridge;
    for (int i = 6; i < 10; ++i) normal(i, i) += degree == 3 ? ridge : 1e9;
    // Nothing to go by: keep the plane.
    if (!(normal(0, 0) > 20.0)) return TableSurface(frame.camera, plane);
    const Vector10 c = normal.ldlt().solve(right);
    if (!c.allFinite()) return TableSurface(frame.camera, plane);
    for (int i = 0; i < 10; ++i) surface.c_[i] = c[i];
  }
  return surface;
}

}  // namespace weft::foreground
