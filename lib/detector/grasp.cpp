#include "detector/grasp.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.hpp"
#include "foreground/table.hpp"

namespace weft::detector {

namespace {

constexpr int kNoHeight = std::numeric_limits<int>::min();

/// Summed-area tables over a grid of pixels (every second one at 640x480), so that means over
/// windows cost the same whatever their size.
class Grid {
 public:
  Grid(const rgbd::RgbdFrame& frame, const cv::Mat& mask, const foreground::TableSurface* surface)
      : step((frame.camera.width + 160) / 320 > 1 ? (frame.camera.width + 160) / 320 : 1),
        width((frame.camera.width - 1 - step / 2) / step + 1),
        height((frame.camera.height - 1 - step / 2) / step + 1) {
    height_um_.resize(static_cast<std::size_t>(width) * height);
    const auto cells = static_cast<std::size_t>(width + 1) * (height + 1);
    heights_.assign(cells, 0);
    valid_.assign(cells, 0);
    garment_.assign(cells, 0);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const int u = pixel(x), v = pixel(y);
        const double z_m = frame.depth_m(u, v);
        int& h = height_um_[index(x, y)];
        h = kNoHeight;
        if (z_m > 0.0) {
          const double h_m = surface ? surface->height_m(u, v, z_m) : -z_m;
          if (std::abs(h_m) < 20.0) h = static_cast<int>(std::lround(h_m * 1e6));
        }
        const std::size_t at = static_cast<std::size_t>(y + 1) * (width + 1) + x + 1;
        const auto sum = [&](const auto& table) {
          return table[at - 1] + table[at - width - 1] - table[at - width - 2];
        };
        heights_[at] = sum(heights_) + (h == kNoHeight ? 0 : h);
        valid_[at] = sum(valid_) + (h != kNoHeight);
        garment_[at] = sum(garment_) + (mask.at<std::uint8_t>(v, u) != 0);
      }
    }
  }

  struct Window {
    std::int64_t height_um = 0;
    int valid = 0, garment = 0, cells = 0;
  };
  /// Of the cells within `radius` columns and rows, cut off at the image's border.
  Window window(int x, int y, int radius) const {
    const int x0 = std::max(0, x - radius), x1 = std::min(width, x + radius + 1);
    const int y0 = std::max(0, y - radius), y1 = std::min(height, y + radius + 1);
    const auto sum = [&](const auto& table) {
      const auto row = [&](int r) { return static_cast<std::size_t>(r) * (width + 1); };
      return table[row(y1) + x1] - table[row(y0) + x1] - table[row(y1) + x0] + table[row(y0) + x0];
    };
    return {sum(heights_), sum(valid_), sum(garment_), (x1 - x0) * (y1 - y0)};
  }
  bool valid(int x, int y) const { return height_um_[index(x, y)] != kNoHeight; }
  int pixel(int cell) const { return cell * step + step / 2; }

  const int step, width, height;

 private:
  std::size_t index(int x, int y) const { return static_cast<std::size_t>(y) * width + x; }
  std::vector<int> height_um_;
  std::vector<std::int64_t> heights_;
  std::vector<int> valid_, garment_;
};

struct Place {
  double quality = 0.0;
  double core_height_m = 0.0;
  int u = 0, v = 0;
};

/// The plane of the cloth around a pixel: 1/z = p . (x, y, 1) by least squares, points far from it
/// losing their weight. Nothing when the patch is not a plane or too little of it is seen.
std::optional<Eigen::Vector3d> fit_patch(const rgbd::RgbdFrame& frame, const cv::Mat& mask, int u0,
                                         int v0, const GraspOptions& options) {
  const rgbd::CameraModel& camera = frame.camera;
  const double z0_m = frame.depth_m(u0, v0);
  const int ru = std::max(2, static_cast<int>(options.patch_m * camera.fx / z0_m + 0.5));
  const int rv = std::max(2, static_cast<int>(options.patch_m * camera.fy / z0_m + 0.5));
  std::vector<Eigen::Vector3d> rays;
  std::vector<double> depths_m;
  for (int v = std::max(0, v0 - rv); v <= std::min(camera.height - 1, v0 + rv); ++v) {
    for (int u = std::max(0, u0 - ru); u <= std::min(camera.width - 1, u0 + ru); ++u) {
      const double z_m = frame.depth_m(u, v);
      if (!(z_m > 0.0) || !mask.at<std::uint8_t>(v, u)) continue;
      const Eigen::Vector3d ray = camera.unproject(u, v, 1.0);
      if ((ray * z_m - camera.unproject(u0, v0, z0_m)).norm() > 1.5 * options.patch_m) continue;
      rays.push_back(ray);
      depths_m.push_back(z_m);
    }
  }
  if (rays.size() < 12) return std::nullopt;
  constexpr double kNoise_m = 0.003;
  Eigen::Vector3d p(0.0, 0.0, 1.0 / z0_m);
  double residual = 0.0;
  for (int iteration = 0; iteration < 6; ++iteration) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    const double inverse_norm = 1.0 / p.norm();
    double squares = 0.0, weights = 0.0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double distance_m = (1.0 - p.dot(rays[i]) * depths_m[i]) * inverse_norm;
      const double d = distance_m / kNoise_m;
      // The first fit is over all points: the fronto-parallel start says nothing yet.
      const double weight = iteration == 0 ? 1.0 : 1.0 / (1.0 + 0.25 * d * d);
      normal += weight * rays[i] * rays[i].transpose();
      right += weight / depths_m[i] * rays[i];
      squares += weight * distance_m * distance_m;
      weights += weight;
    }
    residual = std::sqrt(squares / weights);
    if (iteration == 5) break;
    p = normal.ldlt().solve(right);
    if (!p.allFinite() || !(p.squaredNorm() > 1e-6)) return std::nullopt;
  }
  if (!(residual <= options.max_residual_m)) return std::nullopt;
  return p;
}

/// Removes places at the table's height: noise alone lifts some of them above any fixed small
/// height, so what counts is the height of the cloth around (its upper quartile, of which 10 mm at
/// most: beside a high fold cloth lies flat).
void remove_table(std::vector<Place>& places, const GraspOptions& options) {
  if (places.empty()) return;
  std::vector<double> heights_m;
  for (const Place& place : places) heights_m.push_back(place.core_height_m);
  const auto quartile = heights_m.begin() + static_cast<std::ptrdiff_t>(heights_m.size() * 3 / 4);
  std::nth_element(heights_m.begin(), quartile, heights_m.end());
  const double least_m = std::max(options.min_height_m, 0.7 * std::min(*quartile, 0.010));
  std::erase_if(places, [&](const Place& place) { return !(place.core_height_m >= least_m); });
}

/// Whether a pixel lies in a convex quadrilateral, whichever way round it is.
bool inside(const std::array<Eigen::Vector2d, 4>& corners, const Eigen::Vector2d& px) {
  int left = 0, right = 0;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector2d side = corners[(i + 1) % 4] - corners[i], to = px - corners[i];
    const double cross = side.x() * to.y() - side.y() * to.x();
    left += cross >= 0.0;
    right += cross <= 0.0;
  }
  return left == 4 || right == 4;
}

}  // namespace

void GraspOptions::validate() const {
  validate_fields(*this, "GraspOptions");
  const std::size_t n = T_base_camera.size();
  if (n == 0) return;
  const std::string name = "GraspOptions: T_base_camera ";
  if (n != 7 && n != 16)
    throw Error(name + "has " + std::to_string(n) + " numbers; give none, 7 or 16");
  for (double value : T_base_camera)
    if (!std::isfinite(value)) throw Error(name + "holds a number that is not finite");
  if (n == 7) {
    const Eigen::Map<const Eigen::Vector4d> q(T_base_camera.data() + 3);
    if (std::abs(q.norm() - 1.0) > 1e-3)
      throw Error(name + "has a quaternion of length " + std::to_string(q.norm()) + "; give 1");
    return;
  }
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> t(T_base_camera.data());
  const Eigen::Matrix3d r = t.topLeftCorner<3, 3>();
  if ((r * r.transpose() - Eigen::Matrix3d::Identity()).norm() > 1e-3 ||
      r.col(0).cross(r.col(1)).dot(r.col(2)) < 0.0 ||
      (t.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-9)
    throw Error(name + "is not a rotation and a translation with the last row 0 0 0 1");
}

std::optional<Eigen::Isometry3d> base_from_camera(const GraspOptions& options) {
  options.validate();
  const std::vector<double>& t = options.T_base_camera;
  if (t.empty()) return std::nullopt;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  if (t.size() == 7) {
    pose.translation() = Eigen::Vector3d(t[0], t[1], t[2]);
    pose.linear() = Eigen::Quaterniond(t[6], t[3], t[4], t[5]).normalized().toRotationMatrix();
  } else {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) pose.linear()(r, c) = t[4 * r + c];
      pose.translation()[r] = t[4 * r + 3];
    }
  }
  return pose;
}

std::vector<Grasp> find_grasps(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                               const std::optional<rgbd::Plane>& table,
                               const std::vector<Detection>& detections,
                               const GraspOptions& options) {
  options.validate();
  const rgbd::CameraModel& camera = frame.camera;
  const cv::Size size(camera.width, camera.height);
  if (frame.depth.type() != CV_16UC1 || frame.depth.size() != size || mask.type() != CV_8UC1 ||
      mask.size() != size)
    throw Error("grasps need 16 bit depth and an 8 bit mask of the camera's size");
  std::vector<Grasp> grasps;
  if (detections.empty()) return grasps;

  std::optional<foreground::TableSurface> surface;
  if (table) surface = foreground::fit_surface(frame, mask, *table, 3);
  const Grid grid(frame, mask, surface ? &*surface : nullptr);

  for (std::size_t k = 0; k < detections.size(); ++k) {
    const Detection& detection = detections[k];
    const auto& corners = detection.corners_sensor_px;
    Eigen::Vector2d low = corners[0], high = corners[0];
    for (const Eigen::Vector2d& corner : corners) {
      low = low.cwiseMin(corner);
      high = high.cwiseMax(corner);
    }
    const double box_px =
        std::sqrt(std::abs((corners[2] - corners[0]).x() * (corners[3] - corners[1]).y() -
                           (corners[2] - corners[0]).y() * (corners[3] - corners[1]).x()) /
                  2.0);
    if (!(box_px > 0.0) || !low.allFinite() || !high.allFinite()) continue;
    const auto cell = [&](double px, int count) {
      return static_cast<int>(std::clamp((px - grid.pixel(0)) / grid.step, 0.0, count - 1.0));
    };
    std::vector<Place> places;
    for (int y = cell(low.y(), grid.height); y <= cell(high.y(), grid.height); ++y) {
      for (int x = cell(low.x(), grid.width); x <= cell(high.x(), grid.width); ++x) {
        const int u = grid.pixel(x), v = grid.pixel(y);
        if (!grid.valid(x, y) || !mask.at<std::uint8_t>(v, u)) continue;
        const Eigen::Vector2d px(u, v);
        if (!inside(corners, px)) continue;
        const double cells_per_m = camera.fx / (frame.depth_m(u, v) * grid.step);
        const auto cells = [&](double length_m) {
          return static_cast<int>(std::min(length_m * cells_per_m + 0.5, 1000.0));
        };
        const int patch = std::max(1, cells(options.patch_m));
        const Grid::Window margin = grid.window(x, y, cells(options.outline_margin_m));
        if (margin.garment < margin.cells) continue;
        const Grid::Window near = grid.window(x, y, patch);
        if (near.valid < options.min_coverage * near.cells) continue;
        const double height_m = 1e-6 * static_cast<double>(near.height_um) / near.valid;
        const Grid::Window core = grid.window(x, y, std::max(1, patch / 2));
        const double core_height_m = 1e-6 * static_cast<double>(core.height_um) / core.valid;
        const Grid::Window wide = grid.window(x, y, 3 * patch);
        double prominence = 0.0;
        if (wide.valid > near.valid) {
          prominence = (height_m - 1e-6 * static_cast<double>(wide.height_um - near.height_um) /
                                       (wide.valid - near.valid)) /
                       options.prominence_m;
        }
        const double off =
            (px - detection.centre_sensor_px).norm() / (options.centre_share * box_px);
        const double quality =
            (1.0 - options.prominence_weight * (1.0 - std::clamp(prominence, 0.0, 1.0))) /
            (1.0 + off * off);
        places.push_back({quality, core_height_m, u, v});
      }
    }
    if (table) remove_table(places, options);
    // Ties go to the pixel that comes first, so that the order is one and the same everywhere.
    std::stable_sort(places.begin(), places.end(),
                     [](const Place& a, const Place& b) { return a.quality > b.quality; });
    const std::size_t tries = std::min<std::size_t>(places.size(), 50);
    for (std::size_t i = 0; i < tries; ++i) {
      const Place& place = places[i];
      const auto p = fit_patch(frame, mask, place.u, place.v, options);
      if (!p) continue;
      const Eigen::Vector3d ray = camera.unproject(place.u, place.v, 1.0);
      const double z_m = 1.0 / p->dot(ray);
      if (!(std::abs(z_m - frame.depth_m(place.u, place.v)) <= 2.0 * options.max_residual_m))
        continue;
      if (surface && surface->height_m(place.u, place.v, z_m) < options.min_height_m) continue;
      Grasp grasp;
      grasp.part = detection.part;
      grasp.detection = static_cast<int>(k);
      grasp.score = std::clamp(detection.probability * place.quality, 0.0, 1.0);
      grasp.pixel = Eigen::Vector2d(place.u, place.v);
      grasp.point_camera_m = z_m * ray;
      grasp.approach_camera = p->normalized();
      grasps.push_back(std::move(grasp));
      break;
    }
  }
  std::stable_sort(grasps.begin(), grasps.end(),
                   [](const Grasp& a, const Grasp& b) { return a.score > b.score; });
  return grasps;
}

}  // namespace weft::detector
