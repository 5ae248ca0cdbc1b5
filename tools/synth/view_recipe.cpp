#include "synth/view_recipe.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace weft::synth {
namespace {

struct Box {
  Vec2 low = Vec2::Constant(1e9f), high = Vec2::Constant(-1e9f);
};

Box bounds(const Simulation& s, const Placement& placement) {
  Box box;
  for (const auto& p : s.pose) {
    const Vec2 q = placement.apply(p).head<2>();
    box.low = box.low.cwiseMin(q);
    box.high = box.high.cwiseMax(q);
  }
  return box;
}

/// A random point of a random part, the middle of the garment if it has none.
Vec2 point_of_interest(Random& r, const Simulation& s, const Vec2& middle) {
  if (s.parts.empty()) return middle;
  const auto& part = s.parts[r.below(s.parts.size())];
  if (part.regions.empty()) return middle;
  const auto& region = part.regions[r.below(part.regions.size())];
  Vec2 centre = Vec2::Zero();
  for (const auto& p : region.points) centre += p / static_cast<float>(region.points.size());
  float best = 1e9f;
  Vec2 out = middle;
  for (std::size_t f = 0; f < s.faces.size(); ++f) {
    if (s.panel_of_face[f] != region.panel) continue;
    const auto v = static_cast<std::size_t>(s.faces[f][0]);
    const float d = (s.pattern[v] - centre).squaredNorm();
    if (d < best) {
      best = d;
      out = s.pose[v].head<2>();
    }
  }
  return out;
}

}  // namespace

void draw_sensors(Random& r, ColourSensor& c, DepthSensor& d) {
  const auto u = [&](double a, double b) { return static_cast<float>(r.uniform(a, b)); };
  c.mean_level = u(0.12, 0.6);
  c.bright_level = r.uniform() < 0.85 ? u(0.5, 0.95) : u(0.95, 1.6);
  c.balance = Vec3(u(0.82, 1.2), u(0.92, 1.08), u(0.8, 1.2));
  c.blur_px = r.uniform() < 0.65 ? u(0.35, 0.95) : u(0.8, 1.4);
  c.noise_grey = u(1.4, 2.6);
  c.vignetting = r.uniform() < 0.5 ? u(0.0, 0.2) : u(0.2, 0.6);
  c.gamma = u(1.8, 2.4);
  c.contrast = u(0.0, 0.5);
  c.black_level = r.uniform() < 0.5 ? 0.0f : u(-4.0, 12.0);
  c.sharpening = r.uniform() < 0.5 ? 0.0f : u(0.0, 0.6);
  c.mosaic = r.uniform() < 0.6;
  if (c.mosaic) c.blur_px = std::max(c.blur_px, 0.55f);
  c.saturation = u(0.6, 1.15);
  c.jpeg_quality = r.uniform() < 0.6 ? 0 : static_cast<int>(r.integer(92, 97));

  d.focal_px = u(565.0, 590.0);
  d.window_px = static_cast<int>(r.integer(2, 4));
  d.noise_px = u(0.0, 0.015);
  d.blotch_px = u(0.025, 0.055);
  d.blotch_size_px = u(4.0, 8.0);
  d.band_px = u(0.0, 0.05);
  d.band_width_px = u(95.0, 115.0);
  d.warp_m = u(0.0, 0.005);
  for (auto& w : d.warp) w = u(-1.0, 1.0);
  d.shift_x_px = u(-2.0, 2.0);
  d.shift_y_px = u(-2.0, 2.0);
  const bool holes = r.uniform() < 0.5;
  d.edge_loss = holes ? u(0.1, 0.8) : 0.0f;
  d.steep_loss = holes ? u(0.1, 0.4) : u(0.0, 0.15);
  d.fill_px = static_cast<int>(holes ? r.integer(0, 3) : r.integer(8, 24));
  if (r.uniform() < 0.7) {
    d.border_px[0] = static_cast<int>(r.integer(0, 14));
    d.border_px[1] = static_cast<int>(r.integer(0, 16));
    d.border_px[2] = static_cast<int>(r.integer(5, 50));
    d.border_px[3] = static_cast<int>(r.integer(0, 24));
  } else {
    d.border_px[r.below(2) * 2] = 8;  // columns without a full window
  }
  d.projector_sign = r.uniform() < 0.5 ? -1.0f : 1.0f;
}

ViewRecipe draw_view(Random& r, const std::vector<const Simulation*>& objects, bool held_out) {
  ViewRecipe v;
  const auto u = [&](double a, double b) { return static_cast<float>(r.uniform(a, b)); };
  const auto turned = [&] {
    const double angle = r.uniform(0.0, 2 * kPi);
    return std::pair(static_cast<float>(sine(angle)), static_cast<float>(cosine(angle)));
  };
  v.placements.resize(objects.size());
  Box box = bounds(*objects[0], v.placements[0]);
  Vec2 target = 0.5f * (box.low + box.high);
  const float extent = (box.high - box.low).maxCoeff();
  if (objects.size() > 1) {
    auto& second = v.placements[1];
    std::tie(second.sine, second.cosine) = turned();
    const Box other = bounds(*objects[1], second);
    second.offset =
        Vec2(box.high.x() - other.low.x() + u(0.01, 0.08),
             0.5f * (box.low.y() + box.high.y() - other.low.y() - other.high.y()) + u(-0.15, 0.15));
    target = Vec2(box.high.x() + u(-0.15, 0.1), target.y());
  } else if (r.uniform() < 0.45) {
    const Vec2 interest = point_of_interest(r, *objects[0], target);
    target = target + (interest - target) * u(0.3, 1.0);
  }
  target += Vec2(u(-0.1, 0.1), u(-0.1, 0.1));

  auto& camera = v.camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = r.uniform() < 0.3 ? 525.0 : r.uniform(500.0, 600.0);
  camera.cx = 319.5 + r.uniform(-5.0, 5.0);
  camera.cy = 239.5 + r.uniform(-5.0, 5.0);
  float height = u(0.6, 1.3);
  if (extent > 0.55f) height = std::max(height, u(0.6, 1.3));
  const double tilt = r.uniform() < 0.3 ? r.uniform(0.0, 0.03) : r.uniform(0.0, 0.26);
  const auto [ts, tc] = turned();
  v.pose.forward = Vec3(static_cast<float>(sine(tilt)) * tc, static_cast<float>(sine(tilt)) * ts,
                        -static_cast<float>(cosine(tilt)));
  const auto [ys, yc] = turned();
  const Vec3 right(yc, ys, 0.0f);
  v.pose.right = (right - right.dot(v.pose.forward) * v.pose.forward).normalized();
  v.pose.down = v.pose.forward.cross(v.pose.right);
  v.pose.origin = Vec3(target.x(), target.y(), 0.0f) -
                  v.pose.forward * (height / static_cast<float>(cosine(tilt)));
  v.mirrored = r.uniform() < 0.5;

  v.table = draw_table(r);
  v.table.centre += target;
  v.lighting = draw_lighting(r, v.pose.origin - Vec3(target.x(), target.y(), 0.0f));
  for (auto& light : v.lighting.points) light.position += Vec3(target.x(), target.y(), 0.0f);
  for (const auto* s : objects) v.fabrics.push_back(draw_fabric(r, held_out, v.table.base, *s));

  draw_sensors(r, v.colour, v.depth);
  v.sensor_seed = r.bits();
  for (auto& fabric : v.fabrics) draw_wear(r, fabric);
  v.contact = u(0.1, 1.0);
  return v;
}

}  // namespace weft::synth
