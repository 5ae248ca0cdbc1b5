#include "train/samples.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/random.hpp"
#include "foreground/foreground.hpp"

namespace weft::train {
namespace {

constexpr double kPi = 3.14159265358979323846;

void hash_image(Hash64& hash, const cv::Mat& image) {
  hash.add(static_cast<std::uint64_t>(image.rows));
  hash.add(static_cast<std::uint64_t>(image.cols));
  hash.add(static_cast<std::uint64_t>(image.type()));
  for (int y = 0; y < image.rows; ++y) {
    hash.add(image.ptr(y), static_cast<std::size_t>(image.cols) * image.elemSize());
  }
}

detector::Box bounds(const std::vector<cv::Point2f>& polygon) {
  float left = polygon.front().x, right = left, top = polygon.front().y, bottom = top;
  for (const auto& p : polygon) {
    left = std::min(left, p.x);
    right = std::max(right, p.x);
    top = std::min(top, p.y);
    bottom = std::max(bottom, p.y);
  }
  return {left, top, static_cast<double>(right) - left, static_cast<double>(bottom) - top};
}

}  // namespace

rgbd::View turned_view(const rgbd::View& view, const cv::Mat& view_mask, double angle_rad,
                       bool mirrored, int margin_px) {
  // old = rotation * mirror * (new + corner)
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  Eigen::Matrix3d old_from_turned;
  old_from_turned << c, -s, 0, s, c, 0, 0, 0, 1;
  if (mirrored) old_from_turned.col(0) *= -1.0;
  const Eigen::Matrix3d turned_from_old = old_from_turned.inverse();
  double left = 1e9, right = -1e9, top = 1e9, bottom = -1e9;
  for (int y = 0; y < view_mask.rows; ++y) {
    const auto* row = view_mask.ptr<std::uint8_t>(y);
    for (int x = 0; x < view_mask.cols; ++x) {
      if (row[x] == 0) continue;
      const Eigen::Vector3d p = turned_from_old * Eigen::Vector3d(x, y, 1.0);
      left = std::min(left, p.x());
      right = std::max(right, p.x());
      top = std::min(top, p.y());
      bottom = std::max(bottom, p.y());
    }
  }
  if (right < left) throw Error("no garment in the view");
  left = std::floor(left) - margin_px;
  top = std::floor(top) - margin_px;
  rgbd::View turned = view;
  turned.width = static_cast<int>(std::ceil(right) - left) + 1 + margin_px;
  turned.height = static_cast<int>(std::ceil(bottom) - top) + 1 + margin_px;
  Eigen::Matrix3d shift = Eigen::Matrix3d::Identity();
  shift(0, 2) = left;
  shift(1, 2) = top;
  turned.sensor_from_view = view.sensor_from_view * old_from_turned * shift;
  return turned;
}

std::uint64_t hash_scene(const dataset::Scene& scene) {
  Hash64 hash;
  hash.add(scene.name);
  hash.add(scene.simulation);
  hash.add(scene.garment);
  hash_image(hash, scene.frame.colour);
  hash_image(hash, scene.frame.depth);
  hash_image(hash, scene.frame.mask);
  const auto& camera = scene.frame.camera;
  for (const double value :
       {camera.fx, camera.fy, camera.cx, camera.cy, scene.frame.depth_unit_m}) {
    hash.add(&value, sizeof value);
  }
  for (const auto& polygon : scene.polygons) {
    hash.add(polygon.part);
    hash.add(static_cast<std::uint64_t>(polygon.ignore));
    hash.add(&polygon.visible_share, sizeof polygon.visible_share);
    hash.add(polygon.points.data(), polygon.points.size() * sizeof(cv::Point2f));
  }
  return hash.value();
}

std::vector<ViewPart> parts_in_view(const std::vector<dataset::PartPolygon>& polygons,
                                    const rgbd::View& view) {
  std::vector<ViewPart> parts;
  for (const auto& polygon : polygons) {
    const auto found = std::find(detector::kParts.begin(), detector::kParts.end(), polygon.part);
    if (found == detector::kParts.end()) throw Error("unknown part '" + polygon.part + "'");
    if (polygon.points.size() < 3) continue;
    ViewPart part;
    part.part = static_cast<int>(found - detector::kParts.begin());
    part.ignore = polygon.ignore;
    part.visible_share = polygon.visible_share;
    for (const auto& point : polygon.points) {
      const auto p = view.to_view({point.x, point.y});
      part.polygon.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
    }
    part.box = bounds(part.polygon);
    parts.push_back(std::move(part));
  }
  return parts;
}

DescribedScene describe_scene(const dataset::Scene& scene, const bovw::DescribeOptions& options,
                              const AugmentOptions& augment) {
  DescribedScene result;
  result.name = scene.name;
  result.simulation = scene.simulation.empty() ? scene.name : scene.simulation;
  result.garment = scene.garment;
  result.data_hash = hash_scene(scene);
  foreground::ForegroundOptions foreground_options;
  foreground_options.mode = foreground::Foreground::Source::kDataset;
  const auto foreground = foreground::find_foreground(scene.frame, foreground_options);
  const auto* table = foreground.table ? &*foreground.table : nullptr;
  const auto base = rgbd::make_view(scene.frame, foreground.mask, table, options.view);
  const auto descriptor = descriptor::make_descriptor(options.descriptor);
  const auto describe = [&](const rgbd::View& view) {
    DescribedView described;
    described.described.view = view;
    const auto images = rgbd::render_view(scene.frame, foreground.mask, view);
    described.described.field = descriptor->describe(
        scene.frame, view, images, descriptor::make_grid(view.width, view.height, options.grid), 1);
    described.parts = parts_in_view(scene.polygons, view);
    result.views.push_back(std::move(described));
  };
  if (base.kind == rgbd::View::Kind::kSensor) {
    describe(base);
    return result;
  }
  const auto base_images = rgbd::render_view(scene.frame, foreground.mask, base);
  const int margin = static_cast<int>(options.view.margin_m * options.view.scale_px_per_m);
  const double first = Random(result.data_hash).uniform(0.0, 2.0 * kPi / augment.turns);
  for (int turn = 0; turn < augment.turns; ++turn) {
    const double angle = first + 2.0 * kPi * turn / augment.turns;
    for (const bool mirrored : {false, true}) {
      if (mirrored && !augment.mirror) continue;
      describe(turned_view(base, base_images.mask, angle, mirrored, margin));
    }
  }
  return result;
}

void write_scene(const std::string& path, std::uint64_t key, const DescribedScene& scene) {
  BlobWriter blob("described-scene", 2);
  blob.add_number("key", static_cast<std::int64_t>(key));
  blob.add("name", scene.name);
  blob.add("simulation", scene.simulation);
  blob.add("garment", scene.garment);
  blob.add_number("data_hash", static_cast<std::int64_t>(scene.data_hash));
  blob.add_number("views", static_cast<std::int64_t>(scene.views.size()));
  for (std::size_t i = 0; i < scene.views.size(); ++i) {
    const auto name = "view." + std::to_string(i) + ".";
    const auto& view = scene.views[i].described.view;
    const auto& field = scene.views[i].described.field;
    const std::vector<std::int32_t> geometry = {view.kind == rgbd::View::Kind::kRectified,
                                                view.width,
                                                view.height,
                                                field.grid.origin_x,
                                                field.grid.origin_y,
                                                field.grid.step_px,
                                                field.grid.columns,
                                                field.grid.rows,
                                                field.dimension};
    blob.add(name + "geometry", std::span<const std::int32_t>(geometry));
    std::vector<std::uint8_t> states;
    for (const auto state : field.state) states.push_back(static_cast<std::uint8_t>(state));
    blob.add(name + "states", std::span<const std::uint8_t>(states));
    blob.add(name + "points", std::span<const std::int32_t>(field.points));
    blob.add(name + "values", std::span<const std::uint8_t>(field.values));
    std::vector<std::int32_t> heads;
    std::vector<float> points;
    std::vector<double> visible;
    for (const auto& part : scene.views[i].parts) {
      heads.insert(heads.end(), {part.part, part.ignore, static_cast<int>(part.polygon.size())});
      for (const auto& p : part.polygon) points.insert(points.end(), {p.x, p.y});
      visible.push_back(part.visible_share);
    }
    blob.add(name + "parts", std::span<const std::int32_t>(heads));
    blob.add(name + "polygons", std::span<const float>(points));
    blob.add(name + "visible", std::span<const double>(visible));
  }
  blob.write(path);
}

bool read_scene(const std::string& path, std::uint64_t key, DescribedScene& scene) {
  if (!std::filesystem::exists(path)) return false;
  const auto blob = BlobReader::from_file(path, "described-scene", 2);
  if (static_cast<std::uint64_t>(blob.integer("key", INT64_MIN, INT64_MAX)) != key) return false;
  scene = {};
  scene.name = blob.text("name");
  scene.simulation = blob.text("simulation");
  scene.garment = blob.text("garment");
  scene.data_hash = static_cast<std::uint64_t>(blob.integer("data_hash", INT64_MIN, INT64_MAX));
  scene.views.resize(static_cast<std::size_t>(blob.integer("views", 0, 1000)));
  for (std::size_t i = 0; i < scene.views.size(); ++i) {
    const auto name = "view." + std::to_string(i) + ".";
    auto& view = scene.views[i].described.view;
    auto& field = scene.views[i].described.field;
    const auto geometry = blob.values<std::int32_t>(name + "geometry", 9);
    view.kind = geometry[0] ? rgbd::View::Kind::kRectified : rgbd::View::Kind::kSensor;
    view.width = geometry[1];
    view.height = geometry[2];
    field.grid = {geometry[3], geometry[4], geometry[5], geometry[6], geometry[7]};
    field.dimension = geometry[8];
    for (const auto state : blob.values<std::uint8_t>(name + "states", field.grid.cells())) {
      field.state.push_back(static_cast<descriptor::PointState>(state));
    }
    field.points = blob.values<std::int32_t>(name + "points");
    field.values = blob.values<std::uint8_t>(
        name + "values", field.points.size() * static_cast<std::size_t>(field.dimension));
    const auto heads = blob.values<std::int32_t>(name + "parts");
    const auto points = blob.values<float>(name + "polygons");
    const auto visible = blob.values<double>(name + "visible", heads.size() / 3);
    std::size_t at = 0;
    for (std::size_t h = 0; h + 2 < heads.size(); h += 3) {
      ViewPart part;
      part.part = heads[h];
      part.ignore = heads[h + 1] != 0;
      part.visible_share = visible[h / 3];
      for (int k = 0; k < heads[h + 2]; ++k, at += 2) {
        if (at + 1 >= points.size()) blob.fail(name + "polygons is too short");
        part.polygon.emplace_back(points[at], points[at + 1]);
      }
      if (part.polygon.empty()) blob.fail(name + "parts holds an empty polygon");
      part.box = bounds(part.polygon);
      scene.views[i].parts.push_back(std::move(part));
    }
  }
  return true;
}

}  // namespace weft::train
