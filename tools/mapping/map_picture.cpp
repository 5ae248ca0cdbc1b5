#include "mapping/map_picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "mapping/colours.hpp"

namespace weft::mapping {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

cv::Scalar scalar(const Colour& c, double shade = 1.0) {
  return {c.blue * shade, c.green * shade, c.red * shade};
}

/// A parallel projection: rows x (right), y (down in the picture), z (away from the viewer).
struct View {
  Eigen::Matrix3d rotation;
  double scale = 1.0;  // px a metre
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();
  cv::Point operator()(const Eigen::Vector3d& p) const {
    const Eigen::Vector3d q = rotation * p;
    return {static_cast<int>(std::lround(q.x() * scale + offset.x())),
            static_cast<int>(std::lround(q.y() * scale + offset.y()))};
  }
};

std::vector<Eigen::Vector3d> extent(const MapContent& content) {
  std::vector<Eigen::Vector3d> all;
  for (const auto& [id, p] : content.map.points) all.push_back(p.position_world);
  for (const auto& [id, p] : content.map.planes)
    for (const auto& v : p.cloud_world) all.push_back(v.cast<double>());
  for (const auto& p : content.path) all.push_back(p.camera_in_world);
  for (const auto& [id, k] : content.map.key_frames)
    all.push_back(k.T_camera_world.inverse().translation);
  return all;
}

/// Makes what lies between the 0.5 % and 99.5 % quantiles, and all garments, fill the picture:
/// single stray points do not shrink the rest.
void fit(View& view, const MapContent& content, const PictureOptions& options) {
  const std::vector<Eigen::Vector3d> all = extent(content);
  constexpr double kMargin = 0.06;
  Eigen::Vector2d low(-1, -1), high(1, 1);
  for (int axis = 0; axis < 2 && !all.empty(); ++axis) {
    std::vector<double> values;
    for (const auto& p : all) values.push_back((view.rotation * p)[axis]);
    std::sort(values.begin(), values.end());
    const auto cut = values.size() / 200;
    low[axis] = values[cut];
    high[axis] = values[values.size() - 1 - cut];
  }
  for (const auto& garment : content.garments) {
    if (!garment.in_map) continue;
    const Eigen::Vector2d at = (view.rotation * garment.position_world).head<2>();
    low = low.cwiseMin(at - Eigen::Vector2d::Constant(garment.extent_m));
    high = high.cwiseMax(at + Eigen::Vector2d::Constant(garment.extent_m));
  }
  const Eigen::Vector2d size = (high - low).cwiseMax(0.1);
  view.scale =
      (1.0 - 2.0 * kMargin) * std::min(options.width_px / size.x(), options.height_px / size.y());
  view.offset =
      0.5 * Eigen::Vector2d(options.width_px, options.height_px) - 0.5 * view.scale * (low + high);
}

/// Axes of the ground: right and ahead of the first camera, level.
void ground(const slam::Map& map, const Eigen::Vector3d& up, Eigen::Vector3d& right,
            Eigen::Vector3d& ahead) {
  Eigen::Quaterniond R_world_camera = Eigen::Quaterniond::Identity();
  if (!map.key_frames.empty())
    R_world_camera = map.key_frames.begin()->second.T_camera_world.rotation.conjugate();
  ahead = R_world_camera * Eigen::Vector3d::UnitZ();
  // A camera that looks down has ahead where its picture has up.
  if (ahead.dot(up) < -std::cos(30.0 * kDegree)) ahead = R_world_camera * -Eigen::Vector3d::UnitY();
  ahead -= up * up.dot(ahead);
  if (ahead.norm() < 1e-3) ahead = up.unitOrthogonal();
  ahead.normalize();
  right = ahead.cross(up).normalized();
}

void draw(const MapContent& content, const View& view, cv::Mat& picture) {
  // Far to near.
  struct Dot {
    double away;
    cv::Point at;
    cv::Scalar colour;
    int radius;
  };
  std::vector<Dot> dots;
  double nearest = 1e9, farthest = -1e9;
  const auto add = [&](const Eigen::Vector3d& p, const Colour& colour, int radius) {
    const double away = (view.rotation * p).z();
    nearest = std::min(nearest, away);
    farthest = std::max(farthest, away);
    dots.push_back({away, view(p), scalar(colour), radius});
  };
  const int voxel = std::clamp(static_cast<int>(0.025 * view.scale), 1, 6);
  for (const auto& [id, plane] : content.map.planes)
    for (const auto& p : plane.cloud_world) add(p.cast<double>(), plane_colour(id), voxel);
  for (const auto& [id, p] : content.map.points) add(p.position_world, kPointColour, 1);
  std::stable_sort(dots.begin(), dots.end(),
                   [](const Dot& a, const Dot& b) { return a.away > b.away; });
  for (const auto& dot : dots) {
    // What is far fades a little.
    const double fade = farthest > nearest ? 0.45 * (dot.away - nearest) / (farthest - nearest) : 0;
    cv::circle(picture, dot.at, dot.radius, dot.colour * (1.0 - fade) + cv::Scalar::all(255 * fade),
               cv::FILLED, cv::LINE_AA);
  }
  for (std::size_t i = 1; i < content.path.size(); ++i)
    cv::line(picture, view(content.path[i - 1].camera_in_world),
             view(content.path[i].camera_in_world), scalar(kPathColour), 2, cv::LINE_AA);
  // A key frame: a small pyramid that opens where the camera looks.
  for (const auto& [id, k] : content.map.key_frames) {
    const auto T_world_camera = k.T_camera_world.inverse();
    const double size = 0.08;
    std::vector<cv::Point> corners;
    for (const auto& [x, y] : {std::pair(-0.6, -0.45), {0.6, -0.45}, {0.6, 0.45}, {-0.6, 0.45}})
      corners.push_back(view(T_world_camera * Eigen::Vector3d(x * size, y * size, size)));
    const cv::Point tip = view(T_world_camera.translation);
    const cv::Scalar colour(60, 30, 30);
    cv::polylines(picture, corners, true, colour, 1, cv::LINE_AA);
    for (const auto& corner : corners) cv::line(picture, tip, corner, colour, 1, cv::LINE_AA);
  }
}

/// What is in the map for good: the reach of each garment, and its parts by name.
void draw_garments(const MapContent& content, const View& view, cv::Mat& picture) {
  const cv::Scalar colour = scalar(kGarmentColour);
  const auto label = [&](const std::string& text, cv::Point at) {
    cv::putText(picture, text, at + cv::Point(8, 4), cv::FONT_HERSHEY_SIMPLEX, 0.45,
                cv::Scalar::all(255), 3, cv::LINE_AA);
    cv::putText(picture, text, at + cv::Point(8, 4), cv::FONT_HERSHEY_SIMPLEX, 0.45, colour, 1,
                cv::LINE_AA);
  };
  for (const auto& garment : content.garments) {
    if (!garment.in_map) continue;
    const cv::Point at = view(garment.position_world);
    cv::circle(picture, at, std::max(4, static_cast<int>(garment.extent_m * view.scale)), colour, 2,
               cv::LINE_AA);
    label(fmt::format("garment {}", garment.id), at);
    for (const auto& part : garment.parts) {
      const cv::Point place = view(part.position_world);
      cv::drawMarker(picture, place, colour, cv::MARKER_TILTED_CROSS, 10, 2, cv::LINE_AA);
      if (part.probability >= 0.05)
        label(fmt::format("{} {:.0f} %", part.part, 100.0 * part.probability), place);
    }
  }
}

void write(cv::Mat& picture, const MapContent& content, const View& view) {
  std::size_t confirmed = 0;
  for (const auto& [id, p] : content.map.planes) confirmed += p.confirmed;
  const std::string text = fmt::format(
      "{} key frames, {} points, {} planes ({} confirmed), {} poses", content.map.key_frames.size(),
      content.map.points.size(), content.map.planes.size(), confirmed, content.path.size());
  cv::putText(picture, text, {14, picture.rows - 16}, cv::FONT_HERSHEY_SIMPLEX, 0.55,
              cv::Scalar(40, 40, 40), 1, cv::LINE_AA);
  const int metre = static_cast<int>(std::lround(view.scale));
  cv::line(picture, {14, picture.rows - 44}, {14 + metre, picture.rows - 44},
           cv::Scalar(40, 40, 40), 2);
  cv::putText(picture, "1 m", {18, picture.rows - 52}, cv::FONT_HERSHEY_SIMPLEX, 0.5,
              cv::Scalar(40, 40, 40), 1, cv::LINE_AA);
}

}  // namespace

Eigen::Vector3d up_direction(const MapContent& content) {
  const slam::Map& map = content.map;
  for (const auto& garment : content.garments) {
    const auto plane = map.planes.find(garment.supporting_plane);
    if (garment.in_map && plane != map.planes.end()) return plane->second.normal_world;
  }
  Eigen::Vector3d camera_up(0, -1, 0);
  if (!map.key_frames.empty())
    camera_up = map.key_frames.begin()->second.T_camera_world.rotation.conjugate() *
                Eigen::Vector3d(0, -1, 0);
  // A camera that looks down on a table has its up far from the table's.
  const double least = std::cos(60.0 * kDegree);
  const slam::MapPlane* largest = nullptr;
  for (const auto& [id, plane] : map.planes) {
    if (plane.normal_world.dot(camera_up) < least) continue;
    if (!largest || plane.cloud_world.size() > largest->cloud_world.size()) largest = &plane;
  }
  return largest ? largest->normal_world : camera_up;
}

cv::Mat top_picture(const MapContent& content, const PictureOptions& options) {
  const Eigen::Vector3d up = up_direction(content);
  Eigen::Vector3d right, ahead;
  ground(content.map, up, right, ahead);
  View view;
  view.rotation << right.transpose(), -ahead.transpose(), -up.transpose();
  fit(view, content, options);
  cv::Mat picture(options.height_px, options.width_px, CV_8UC3, cv::Scalar::all(255));
  const cv::Scalar grid(228, 228, 228);
  const auto lines = [&](double origin, int size, auto&& draw_line) {
    const double first = std::ceil(-origin / view.scale);
    for (double m = first; m * view.scale + origin < size; ++m)
      draw_line(static_cast<int>(std::lround(m * view.scale + origin)));
  };
  lines(view.offset.x(), picture.cols, [&](int x) {
    cv::line(picture, {x, 0}, {x, picture.rows}, grid, 1);
  });
  lines(view.offset.y(), picture.rows, [&](int y) {
    cv::line(picture, {0, y}, {picture.cols, y}, grid, 1);
  });
  draw(content, view, picture);
  draw_garments(content, view, picture);
  write(picture, content, view);
  return picture;
}

cv::Mat oblique_picture(const MapContent& content, const PictureOptions& options) {
  const Eigen::Vector3d up = up_direction(content);
  Eigen::Vector3d right, ahead;
  ground(content.map, up, right, ahead);
  // 35 degrees above the horizon, 30 degrees from the side.
  const Eigen::Vector3d level = std::cos(30.0 * kDegree) * ahead + std::sin(30.0 * kDegree) * right;
  const Eigen::Vector3d away =
      (std::cos(35.0 * kDegree) * level - std::sin(35.0 * kDegree) * up).normalized();
  const Eigen::Vector3d view_right = away.cross(up).normalized();
  View view;
  view.rotation << view_right.transpose(), away.cross(view_right).transpose(), away.transpose();
  fit(view, content, options);
  cv::Mat picture(options.height_px, options.width_px, CV_8UC3, cv::Scalar::all(255));
  draw(content, view, picture);
  draw_garments(content, view, picture);
  write(picture, content, view);
  return picture;
}

}  // namespace weft::mapping
