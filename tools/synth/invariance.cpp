#include "synth/invariance.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "synth/sensor.hpp"
#include "synth/view_scene.hpp"

namespace weft::synth {
namespace {

constexpr double kBaseDistance_m = 0.8;
constexpr int kOthers = 64;             // places compared with each true match
constexpr double kSamePlace_m = 0.006;  // depth difference up to which a place is seen
constexpr double kDegree = kPi / 180.0;

CameraPose pose_above(const Vec2& target, double distance_m, double turn_deg, double tilt_deg) {
  CameraPose pose;
  const double tilt = tilt_deg * kDegree, turn = turn_deg * kDegree;
  pose.forward = Vec3(0.0f, static_cast<float>(sine(tilt)), -static_cast<float>(cosine(tilt)));
  const Vec3 right(static_cast<float>(cosine(turn)), static_cast<float>(sine(turn)), 0.0f);
  pose.right = (right - right.dot(pose.forward) * pose.forward).normalized();
  pose.down = pose.forward.cross(pose.right);
  pose.origin = Vec3(target.x(), target.y(), 0.0f) - pose.forward * static_cast<float>(distance_m);
  return pose;
}

Eigen::Matrix3d camera_from_world(const CameraPose& pose) {
  Eigen::Matrix3d rotation;
  rotation << pose.right.cast<double>().transpose(), pose.down.cast<double>().transpose(),
      pose.forward.cast<double>().transpose();
  return rotation;
}

/// A picture with what the renderer knows about it.
struct Picture {
  rgbd::RgbdFrame frame;
  rgbd::Plane table;
  cv::Mat depth_m, object;
  CameraPose pose;
};

Picture take(const Garment& garment, ViewRecipe recipe, double noise, std::uint64_t seed) {
  recipe.colour.noise_grey *= static_cast<float>(noise);
  recipe.depth.noise_px *= static_cast<float>(noise);
  recipe.depth.blotch_px *= static_cast<float>(noise);
  recipe.depth.band_px *= static_cast<float>(noise);
  const std::vector<const Garment*> garments = {&garment};
  const ViewScene scene(garments, recipe);
  const IdealImages images = scene.render(2);
  Picture picture;
  picture.pose = recipe.pose;
  picture.depth_m = images.depth_m;
  picture.object = images.object;
  picture.frame.camera = recipe.camera;
  picture.frame.colour = sense_colour(images.radiance, recipe.colour, seed);
  picture.frame.depth = sense_depth(images, recipe.depth, recipe.fabrics, seed);
  picture.frame.mask = images.object == 1;
  picture.table.normal = camera_from_world(recipe.pose).col(2);
  picture.table.distance_m = -static_cast<double>(recipe.pose.origin.z());
  return picture;
}

/// Squared distance of two described points of two fields.
int distance2(const descriptor::DescriptorField& a, std::size_t i,
              const descriptor::DescriptorField& b, std::size_t j) {
  const auto size = static_cast<std::size_t>(a.dimension);
  int sum = 0;
  for (std::size_t k = 0; k < size; ++k) {
    const int d = a.values[i * size + k] - b.values[j * size + k];
    sum += d * d;
  }
  return sum;
}

/// Where a pixel of `from` with its depth is seen in `to`; false when it is hidden or outside.
bool same_place(const Picture& from, const Eigen::Vector2d& px, const Picture& to,
                Eigen::Vector2d& seen) {
  const int u = static_cast<int>(std::floor(px.x() + 0.5));
  const int v = static_cast<int>(std::floor(px.y() + 0.5));
  const auto& mask = from.frame.mask;
  if (u < 0 || v < 0 || u >= mask.cols || v >= mask.rows || mask.at<std::uint8_t>(v, u) == 0)
    return false;
  const double z = static_cast<double>(from.depth_m.at<float>(v, u));
  const Eigen::Vector3d world =
      camera_from_world(from.pose).transpose() * from.frame.camera.unproject(u, v, z) +
      from.pose.origin.cast<double>();
  const Eigen::Vector3d point =
      camera_from_world(to.pose) * (world - to.pose.origin.cast<double>());
  if (!(point.z() > 0.0)) return false;
  // The grid point may lie between pixels; its offset stays the same to first order.
  seen = to.frame.camera.project(point);
  const int tu = static_cast<int>(std::floor(seen.x() + 0.5));
  const int tv = static_cast<int>(std::floor(seen.y() + 0.5));
  if (tu < 0 || tv < 0 || tu >= to.depth_m.cols || tv >= to.depth_m.rows) return false;
  return to.object.at<std::uint8_t>(tv, tu) == 1 &&
         std::abs(static_cast<double>(to.depth_m.at<float>(tv, tu)) - point.z()) < kSamePlace_m;
}

struct Sum {
  double nearer = 0.0;
  int matched = 0, seen = 0, pairs = 0;
};

void compare(const bovw::Described& base, const Picture& base_picture, const bovw::Described& other,
             const Picture& other_picture, Random& random, Sum& sum) {
  const auto& a = base.field;
  const auto& b = other.field;
  std::vector<std::int32_t> index_of(b.state.size(), -1);
  for (std::size_t j = 0; j < b.points.size(); ++j)
    index_of[static_cast<std::size_t>(b.points[j])] = static_cast<std::int32_t>(j);
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    const int cell = a.points[i];
    const Eigen::Vector2d at(a.grid.x(cell % a.grid.columns), a.grid.y(cell / a.grid.columns));
    Eigen::Vector2d seen;
    if (!same_place(base_picture, base.view.to_sensor(at), other_picture, seen)) continue;
    const Eigen::Vector2d px = other.view.to_view(seen);
    const int column =
        static_cast<int>(std::floor((px.x() - b.grid.origin_x) / b.grid.step_px + 0.5));
    const int row = static_cast<int>(std::floor((px.y() - b.grid.origin_y) / b.grid.step_px + 0.5));
    if (column < 0 || row < 0 || column >= b.grid.columns || row >= b.grid.rows) continue;
    ++sum.seen;
    const auto match = index_of[static_cast<std::size_t>(row * b.grid.columns + column)];
    if (match < 0) continue;
    ++sum.matched;
    const int own = distance2(a, i, b, static_cast<std::size_t>(match));
    for (int n = 0; n < kOthers; ++n) {
      const auto j = random.below(b.points.size());
      if (static_cast<std::int64_t>(j) == match) continue;
      const int foreign = distance2(a, i, b, j);
      sum.nearer += own < foreign ? 1.0 : (own == foreign ? 0.5 : 0.0);
      ++sum.pairs;
    }
  }
}

bovw::Described describe(const Picture& picture, const bovw::DescribeOptions& options,
                         const descriptor::DenseDescriptor& descriptor, int threads) {
  return bovw::describe_frame(picture.frame, picture.frame.mask, &picture.table, options,
                              descriptor, threads);
}

}  // namespace

const char* change_name(Change change) {
  switch (change) {
    case Change::kNoise:
      return "sensor noise";
    case Change::kTurn:
      return "in-plane rotation";
    case Change::kTilt:
      return "tilt";
    case Change::kDistance:
      return "distance";
  }
  throw Error("no such change");
}

const char* change_unit(Change change) {
  switch (change) {
    case Change::kNoise:
      return "times";
    case Change::kTurn:
    case Change::kTilt:
      return "deg";
    case Change::kDistance:
      return "m";
  }
  throw Error("no such change");
}

std::vector<double> change_levels(Change change) {
  switch (change) {
    case Change::kNoise:
      return {0.0, 1.0, 2.0, 4.0};
    case Change::kTurn:
      return {0.0, 15.0, 30.0, 60.0, 90.0, 180.0};
    case Change::kTilt:
      return {0.0, 5.0, 10.0, 15.0, 25.0};
    case Change::kDistance:
      return {0.6, 0.7, 0.8, 1.0, 1.2};
  }
  throw Error("no such change");
}

std::vector<CameraChange> plotted_changes() {
  std::vector<CameraChange> changes;
  for (const auto change : kChanges)
    for (const double level : change_levels(change)) changes.push_back({change, level});
  return changes;
}

std::vector<std::vector<MatchStability>> measure_invariance(
    const std::vector<std::string>& simulations,
    const std::vector<bovw::DescribeOptions>& describe_options,
    const std::vector<CameraChange>& changes, int threads,
    const std::function<void(int done, int total)>& report) {
  std::vector<std::unique_ptr<descriptor::DenseDescriptor>> descriptors;
  for (const auto& options : describe_options)
    descriptors.push_back(descriptor::make_descriptor(options.descriptor));
  std::vector<std::vector<MatchStability>> results(describe_options.size());
  for (auto& result : results)
    for (const auto& change : changes) result.push_back({change, 0.0, 0.0, 0});
  std::vector<int> counted(changes.size(), 0);
  const int total = static_cast<int>(simulations.size() * counted.size());
  int done = 0;
  for (std::size_t s = 0; s < simulations.size(); ++s) {
    const Garment garment = prepare_garment(read_simulation(simulations[s]));
    Random random(s + 1);
    ViewRecipe recipe = draw_view(random, {&garment.simulation}, false);
    Vec2 low = Vec2::Constant(1e9f), high = -low;
    for (const auto& p : garment.simulation.pose) {
      low = low.cwiseMin(p.head<2>());
      high = high.cwiseMax(p.head<2>());
    }
    const Vec2 target = 0.5f * (low + high);
    recipe.mirrored = false;
    recipe.camera.fx = recipe.camera.fy = 525.0;
    recipe.camera.cx = 319.5;
    recipe.camera.cy = 239.5;
    recipe.depth.shift_x_px = recipe.depth.shift_y_px = 0.0f;
    recipe.pose = pose_above(target, kBaseDistance_m, 0.0, 0.0);
    const Picture base = take(garment, recipe, 1.0, 1);
    std::vector<bovw::Described> base_described;
    for (std::size_t d = 0; d < describe_options.size(); ++d)
      base_described.push_back(describe(base, describe_options[d], *descriptors[d], threads));
    for (std::size_t at = 0; at < counted.size(); ++at) {
      const auto [change, level] = changes[at];
      recipe.pose =
          pose_above(target, change == Change::kDistance ? level : kBaseDistance_m,
                     change == Change::kTurn ? level : 0.0, change == Change::kTilt ? level : 0.0);
      const Picture other = take(garment, recipe, change == Change::kNoise ? level : 1.0, 2);
      bool used = false;
      for (std::size_t d = 0; d < describe_options.size(); ++d) {
        Random choice(s + 1);
        Sum sum;
        compare(base_described[d], base,
                describe(other, describe_options[d], *descriptors[d], threads), other, choice, sum);
        if (sum.pairs == 0) continue;
        used = true;
        auto& result = results[d][at];
        result.stability += sum.nearer / sum.pairs;
        result.described += static_cast<double>(sum.matched) / sum.seen;
        result.points += sum.matched;
      }
      counted[at] += used ? 1 : 0;
      report(++done, total);
    }
  }
  for (auto& result : results)
    for (std::size_t at = 0; at < counted.size(); ++at) {
      if (counted[at] == 0) continue;
      result[at].stability /= counted[at];
      result[at].described /= counted[at];
    }
  return results;
}

std::string invariance_plot(const std::vector<std::string>& names,
                            const std::vector<std::vector<MatchStability>>& sensor,
                            const std::vector<std::vector<MatchStability>>& rectified) {
  constexpr double kWidth = 250, kHeight = 190, kLeft = 60, kTop = 50, kGapX = 30, kGapY = 64;
  constexpr double kLow = 0.2;  // of the stability axis
  const char* colours[] = {"#1f5fa8", "#c0392b", "#1e8449", "#8e44ad", "#d68910", "#555555"};
  const double columns = static_cast<double>(std::size(kChanges));
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' width='{0:.0f}' height='{1:.0f}' viewBox='0 0 "
      "{0:.0f} "
      "{1:.0f}' font-family='sans-serif' font-size='12'>\n<rect width='100%' height='100%' "
      "fill='white'/>\n",
      kLeft + columns * (kWidth + kGapX) + 90, kTop + 2 * (kHeight + kGapY));
  const std::pair<const char*, const std::vector<std::vector<MatchStability>>*> rows[] = {
      {"sensor view", &sensor}, {"rectified view", &rectified}};
  for (int row = 0; row < 2; ++row) {
    const double y0 = kTop + row * (kHeight + kGapY);
    svg += fmt::format("<text x='{}' y='{}' font-weight='bold'>{}</text>\n", kLeft, y0 - 26,
                       rows[row].first);
    int column = 0;
    for (const auto change : kChanges) {
      const double x0 = kLeft + column * (kWidth + kGapX);
      const auto levels = change_levels(change);
      const auto x = [&](double level) {
        return x0 + (level - levels.front()) / (levels.back() - levels.front()) * kWidth;
      };
      const auto y = [&](double value) {
        return y0 + (1.0 - std::max(0.0, value - kLow) / (1.0 - kLow)) * kHeight;
      };
      svg += fmt::format(
          "<rect x='{}' y='{}' width='{}' height='{}' fill='none' stroke='#999'/>\n"
          "<text x='{}' y='{}' text-anchor='middle'>{}, {}</text>\n",
          x0, y0, kWidth, kHeight, x0 + kWidth / 2, y0 - 8, change_name(change),
          change_unit(change));
      for (const double level : levels)
        svg += fmt::format("<text x='{:.1f}' y='{}' text-anchor='middle' fill='#555'>{}</text>\n",
                           x(level), y0 + kHeight + 16, level);
      for (int tick = 2; tick <= 10; tick += 2) {
        const double value = tick / 10.0;
        svg += fmt::format("<line x1='{0}' x2='{1}' y1='{2:.1f}' y2='{2:.1f}' stroke='#ddd'/>\n",
                           x0, x0 + kWidth, y(value));
        if (column == 0)
          svg += fmt::format("<text x='{}' y='{:.1f}' text-anchor='end' fill='#555'>{}</text>\n",
                             x0 - 6, y(value) + 4, value);
      }
      for (std::size_t d = 0; d < names.size(); ++d) {
        std::string points;
        for (const auto& each : (*rows[row].second)[d])
          if (each.change == change && each.points > 0)
            points += fmt::format("{:.1f},{:.1f} ", x(each.level), y(each.stability));
        svg += fmt::format("<polyline points='{}' fill='none' stroke='{}' stroke-width='2'/>\n",
                           points, colours[d % std::size(colours)]);
        if (change == kChanges[std::size(kChanges) - 1])
          svg += fmt::format("<text x='{}' y='{}' fill='{}'>{}</text>\n", x0 + kWidth + 12,
                             y0 + 16 + 18 * static_cast<double>(d), colours[d % std::size(colours)],
                             names[d]);
      }
      ++column;
    }
  }
  return svg + "</svg>\n";
}

}  // namespace weft::synth
