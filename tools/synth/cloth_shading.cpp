#include "synth/cloth_shading.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace weft::synth {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

}  // namespace

Vec3 cloth_radiance(const Garment& g, const Surface& s, const Fabric& fabric,
                    const std::vector<Irradiance>& light_of_vertex, const RayHit& hit,
                    const Vec3& direction) {
  const Triangle triangle(s, hit);
  const Vec2 p = triangle.blend(s.pattern);
  const int panel = s.panel_of_face[at(hit.face)];
  const PanelMap& map = g.maps[at(panel)];
  const int side = hit.geometric_normal.dot(direction) <= 0.0f ? 0 : 1;
  const float sign = side == 0 ? 1.0f : -1.0f;
  const cv::Point texel = map.texel(p);
  const auto material =
      static_cast<Material>((side == 0 ? map.outside : map.inside).at<std::uint8_t>(texel));
  const Vec3 albedo = fabric.albedo(material, g.simulation.panels[at(panel)], panel, p, side == 1);

  const Vec3 n = triangle.blend(s.normal).normalized();
  Vec3 bent = n;
  const Vec3 e1 = s.position[at(triangle.vertex[1])] - s.position[at(triangle.vertex[0])];
  const Vec3 e2 = s.position[at(triangle.vertex[2])] - s.position[at(triangle.vertex[0])];
  const Vec2 t1 = s.pattern[at(triangle.vertex[1])] - s.pattern[at(triangle.vertex[0])];
  const Vec2 t2 = s.pattern[at(triangle.vertex[2])] - s.pattern[at(triangle.vertex[0])];
  const float determinant = t1.x() * t2.y() - t1.y() * t2.x();
  if (std::abs(determinant) > 1e-9f) {
    constexpr float kStep = 0.0008f;
    const float ease = fabric.ease(material, g.simulation.panels[at(panel)]);
    const auto height = [&](const Vec2& q) {
      return 0.001f * (fabric.seam_relief * map.height_at(q) + fabric.relief_mm(panel, q, ease));
    };
    const float h = height(p);
    const float gx = (height(p + Vec2(kStep, 0)) - h) / kStep;
    const float gy = (height(p + Vec2(0, kStep)) - h) / kStep;
    const Vec3 along_x = ((e1 * t2.y() - e2 * t1.y()) / determinant).normalized();
    const Vec3 along_y = ((e2 * t1.x() - e1 * t2.x()) / determinant).normalized();
    Vec3 slope = gx * along_x + gy * along_y;
    const float steep = slope.norm();
    if (steep > 1.4f) slope *= 1.4f / steep;
    bent = (n - slope).normalized();
  }
  const Irradiance light = [&] {
    Irradiance sum = light_of_vertex[at(triangle.vertex[0])];
    sum *= triangle.weight[0];
    for (int i = 1; i < 3; ++i) {
      Irradiance part = light_of_vertex[at(triangle.vertex[i])];
      part *= triangle.weight[i];
      sum += part;
    }
    return sum;
  }();
  const Vec3& e = light.value[side];
  const float level = std::max(luminance(e), 1e-6f);
  const float change = 1.0f + sign * light.slope[side].dot(bent - n) / level;
  Vec3 radiance = albedo.cwiseProduct(e) * std::clamp(change, 0.12f, 2.5f);
  if (side == 0) {
    const float closed = 1.0f - static_cast<float>(map.crevice.at<std::uint8_t>(texel)) / 255.0f;
    radiance *= 1.0f - fabric.seam_relief * closed;
  }

  const Vec3 view = -direction.normalized();
  const float facing = clamp01(sign * bent.dot(view));
  const float grazing = 1.0f - facing;
  radiance += e * (fabric.sheen * grazing * grazing * grazing);
  float gloss = fabric.gloss;
  if (material == Material::kButton) gloss = 0.15f;
  if (material == Material::kRivet) gloss = 0.6f;
  const float strength = light.slope[side].norm();
  if (gloss > 0.0f && strength > 0.0f) {
    const Vec3 half = (light.slope[side] / strength + view).normalized();
    float k = clamp01(sign * bent.dot(half));
    for (int i = 0; i < 4; ++i) k *= k;
    radiance += Vec3::Constant(gloss * k * strength);
  }
  return radiance;
}

}  // namespace weft::synth
