#include "synth/room_scene.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>

#include "synth/cloth_shading.hpp"

namespace weft::synth {
namespace {

constexpr float kNothing_m = 30.0f;  // depth where a ray leaves the room: beyond every sensor

std::size_t at(int i) { return static_cast<std::size_t>(i); }

Surface placed(Surface s, const Placement& placement) {
  for (auto& p : s.position) p = placement.apply(p);
  for (auto& n : s.normal) n.head<2>() = placement.apply(n).head<2>() - placement.offset;
  return s;
}

}  // namespace

CameraPose look_at(const Vec3& origin, const Vec3& target, const Vec3& up) {
  CameraPose pose;
  pose.origin = origin;
  pose.forward = (target - origin).normalized();
  pose.right = pose.forward.cross(up).normalized();
  pose.down = pose.forward.cross(pose.right);
  return pose;
}

RoomScene::RoomScene(RoomContent content) : content_(std::move(content)) {
  RayScene shadows;  // walls and ceiling let the light in
  std::vector<Surface> coarse;
  const auto& c = content_;
  for (std::size_t i = 0; i < c.garments.size(); ++i) {
    coarse.push_back(placed(c.garments[i]->coarse, c.placements[i]));
    surfaces_.push_back(placed(c.garments[i]->fine, c.placements[i]));
    shadows.add(coarse.back());
  }
  for (const auto& solid : c.room.solids) {
    surfaces_.push_back(tessellate(solid.prism, solid.light_step_m));
    const auto& o = solid.prism.outline;
    const bool is_shell = (o[1] - o[0]).norm() > 3.0f;
    if (!is_shell) shadows.add(surfaces_.back());
  }
  for (const auto& s : surfaces_) scene_.add(s);
  shadows.commit();
  scene_.commit();
  for (std::size_t k = 0; k < surfaces_.size(); ++k) {
    const Surface& s = k < coarse.size() ? coarse[k] : surfaces_[k];
    std::vector<Irradiance> light(s.position.size());
    for (std::size_t v = 0; v < light.size(); ++v) {
      light[v] = irradiance(c.lighting, shadows, s.position[v], s.normal[v],
                            sky_mask(shadows, s.position[v], s.normal[v]), true);
    }
    if (k < coarse.size()) interpolate_new(light, c.garments[k]->parents);
    light_.push_back(std::move(light));
  }
}

Vec3 RoomScene::shade(const RayHit& hit, const Vec3& direction) const {
  if (hit.object < 0) return content_.lighting.sky_base;
  const auto k = at(hit.object);
  const Surface& s = surfaces_[k];
  if (k < content_.garments.size()) {
    return cloth_radiance(*content_.garments[k], s, content_.fabrics[k], light_[k], hit, direction);
  }
  const Triangle triangle(s, hit);
  const Solid& solid = content_.room.solids[k - content_.garments.size()];
  const Paint& paint = content_.room.paints[at(solid.paint)];
  // Every face has a piece of the paint of its own.
  const auto face = static_cast<float>(s.panel_of_face[at(hit.face)]);
  Vec3 light = Vec3::Zero();
  for (int i = 0; i < 3; ++i)
    light += light_[k][at(triangle.vertex[i])].value[0] * triangle.weight[i];
  return paint.albedo(triangle.blend(s.pattern) + Vec2(3.7f * face, 1.3f * face))
      .cwiseProduct(light);
}

RoomImages RoomScene::render(const RoomView& view) const {
  const int width = view.camera.width, height = view.camera.height, n = view.samples;
  const std::size_t garments = content_.garments.size();
  const Vec3& origin = view.pose.origin;
  RoomImages out;
  auto& ideal = out.ideal;
  ideal.radiance = cv::Mat(height, width, CV_32FC3);
  ideal.depth_m = cv::Mat(height, width, CV_32FC1);
  ideal.cosine = cv::Mat(height, width, CV_32FC1);
  ideal.object = cv::Mat(height, width, CV_8UC1, cv::Scalar(0));
  ideal.shadow = cv::Mat(height, width, CV_8UC1, cv::Scalar(0));
  out.instances = cv::Mat(height, width, CV_8UC1, cv::Scalar(0));
  const Vec3 projector = origin + view.pose.right * (view.projector_sign * view.baseline_m);
  const auto ray = [&](double u_px, double v_px) {
    const auto& c = view.camera;
    return Vec3(view.pose.forward + view.pose.right * static_cast<float>((u_px - c.cx) / c.fx) +
                view.pose.down * static_cast<float>((v_px - c.cy) / c.fy));
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Vec3 d = ray(x, y);
      const RayHit hit = scene_.intersect(origin, d);
      Vec3 sum = Vec3::Zero();
      for (int k = 0; k < n * n; ++k) {
        const int row = k / n;
        const Vec3 sample = ray(x - 0.5 + (k % n + 0.5) / n, y - 0.5 + (row + 0.5) / n);
        sum += shade(n == 1 ? hit : scene_.intersect(origin, sample), sample);
      }
      sum /= static_cast<float>(n * n);
      ideal.radiance.at<cv::Vec3f>(y, x) = cv::Vec3f(sum.x(), sum.y(), sum.z());
      if (hit.object < 0) {
        ideal.depth_m.at<float>(y, x) = kNothing_m;
        ideal.cosine.at<float>(y, x) = 1.0f;
        continue;
      }
      const auto k = at(hit.object);
      const Triangle triangle(surfaces_[k], hit);
      const Vec3 normal = triangle.blend(surfaces_[k].normal).normalized();
      if (k < garments) {
        const auto id = static_cast<std::uint8_t>(k + 1);
        ideal.object.at<std::uint8_t>(y, x) = id;
        out.instances.at<std::uint8_t>(y, x) = id;
      } else if (content_.room.solids[k - garments].is_desk) {
        out.instances.at<std::uint8_t>(y, x) = kDeskInstance;
      }
      ideal.depth_m.at<float>(y, x) = hit.distance;
      ideal.cosine.at<float>(y, x) = std::abs(normal.dot(d)) / d.norm();
      const Vec3 point = origin + d * (hit.distance - 0.004f);
      if (scene_.occluded(point, projector - point, 0.0f, 1.0f))
        ideal.shadow.at<std::uint8_t>(y, x) = 255;
    }
  }
  return out;
}

std::vector<RoomScene::PartSeen> RoomScene::parts_seen_from(const Vec3& eye,
                                                            std::size_t garment) const {
  const Surface& s = surfaces_[garment];
  const Garment& g = *content_.garments[garment];
  std::vector<PartSeen> out(g.simulation.parts.size());
  for (std::size_t f = 0; f < s.faces.size(); ++f) {
    const auto [a, b, c] = s.faces[f];
    const PanelMap& map = g.maps[s.panel_of_face[f]];
    const int bits = map.parts.at<int>(
        map.texel((s.pattern[at(a)] + s.pattern[at(b)] + s.pattern[at(c)]) / 3.0f));
    if (bits == 0) continue;
    const Vec3 p = (s.position[at(a)] + s.position[at(b)] + s.position[at(c)]) / 3.0f;
    const float area =
        0.5f *
        (s.position[at(b)] - s.position[at(a)]).cross(s.position[at(c)] - s.position[at(a)]).norm();
    const Vec3 way = eye - p;
    const bool seen = !scene_.occluded(p + way * (0.0005f / way.norm()), way, 0.0f, 1.0f);
    for (std::size_t i = 0; i < out.size(); ++i) {
      if ((bits >> i & 1) == 0) continue;
      out[i].area_m2 += static_cast<double>(area);
      if (!seen) continue;
      out[i].seen_m2 += static_cast<double>(area);
      out[i].centre += area * p;
    }
  }
  for (auto& part : out)
    if (part.seen_m2 > 0.0) part.centre /= static_cast<float>(part.seen_m2);
  return out;
}

}  // namespace weft::synth
