#include "synth/view_scene.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "synth/cloth_shading.hpp"

namespace weft::synth {
namespace {

constexpr double kFineEdge_m = 0.0035;  // triangles below about two pixels do not show
constexpr float kGrid_m = 0.007;        // nodes of light on the table
constexpr float kShadowReach_m = 0.30;  // the table farther from the cloth than this is in the open

std::size_t at(int i) { return static_cast<std::size_t>(i); }

/// Darkens what lies in a dent of a few pixels: beside edges of cloth, where layers meet. The light
/// of the vertices is too coarse to see that.
void add_contact_shadows(const cv::Mat& depth_m, float focal_px, float strength,
                         cv::Mat& radiance) {
  constexpr int kReach = 5;
  constexpr float kMost_m = 0.006f;  // deeper dents are the vertices' business
  constexpr int kWays[4][2] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
  const auto z = [&](int x, int y) {
    return depth_m.at<float>(std::clamp(y, 0, depth_m.rows - 1),
                             std::clamp(x, 0, depth_m.cols - 1));
  };
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) {
      const float own = z(x, y), pixel_m = own / focal_px;
      float closed = 0.0f;
      for (const auto& way : kWays) {
        const float length = way[0] != 0 && way[1] != 0 ? 1.41421356f : 1.0f;
        float horizon[2] = {-1e9f, -1e9f};
        for (int side = 0; side < 2; ++side) {
          for (int r = 1; r <= kReach; ++r) {
            const int s = side == 0 ? r : -r;
            const float rise =
                std::clamp(own - z(x + s * way[0], y + s * way[1]), -kMost_m, kMost_m);
            horizon[side] =
                std::max(horizon[side], rise / (static_cast<float>(r) * length * pixel_m));
          }
        }
        // A slope rises on one side as it falls on the other.
        const float dent = std::max(0.0f, 0.5f * (horizon[0] + horizon[1]));
        closed += 0.25f * dent / (1.0f + dent);
      }
      radiance.at<cv::Vec3f>(y, x) *= 1.0f - strength * closed;
    }
  }
}

Vec3 bilinear(const cv::Mat& image, const Vec2& p) {
  const float x = std::clamp(p.x(), 0.0f, static_cast<float>(image.cols) - 1.001f);
  const float y = std::clamp(p.y(), 0.0f, static_cast<float>(image.rows) - 1.001f);
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
  const float *a = image.ptr<float>(iy) + 3 * ix, *b = image.ptr<float>(iy + 1) + 3 * ix;
  Vec3 out;
  for (int c = 0; c < 3; ++c) {
    out[c] = (a[c] + (a[c + 3] - a[c]) * fx) * (1.0f - fy) + (b[c] + (b[c + 3] - b[c]) * fx) * fy;
  }
  return out;
}

}  // namespace

Garment prepare_garment(Simulation simulation) {
  Garment g;
  g.maps = make_panel_maps(simulation);
  g.coarse.position = simulation.pose;
  g.coarse.pattern = simulation.pattern;
  g.coarse.faces = simulation.faces;
  g.coarse.panel_of_face = simulation.panel_of_face;
  compute_normals(g.coarse);
  smooth(g.coarse, 2, 8);
  while (mean_edge_length(g.coarse) > 2 * kFineEdge_m && g.coarse.faces.size() < 100'000) {
    g.coarse = subdivide(g.coarse, g.parents);
  }
  g.fine = subdivide(g.coarse, g.parents);
  RayScene scene;
  scene.add(g.coarse);
  scene.commit();
  g.blocked.resize(g.coarse.position.size());
  for (std::size_t i = 0; i < g.blocked.size(); ++i) {
    g.blocked[i] = sky_mask(scene, g.coarse.position[i], g.coarse.normal[i]);
  }
  g.simulation = std::move(simulation);
  return g;
}

ViewScene::ViewScene(const std::vector<const Garment*>& garments, const ViewRecipe& recipe)
    : garments_(garments), recipe_(recipe) {
  RayScene coarse_scene;  // shadows of the vertices that carry the light
  std::vector<Surface> coarse;
  const auto place = [&](const Surface& surface, const Placement& placement) {
    Surface s = surface;
    for (auto& p : s.position) {
      p = placement.apply(p);
      p.z() += recipe.table.height_m(p.head<2>());
    }
    for (auto& n : s.normal) {
      n.head<2>() = placement.apply(n).head<2>() - placement.offset;
    }
    return s;
  };
  for (std::size_t i = 0; i < garments.size(); ++i) {
    coarse.push_back(place(garments[i]->coarse, recipe.placements[i]));
    surfaces_.push_back(place(garments[i]->fine, recipe.placements[i]));
    coarse_scene.add(coarse.back());
    scene_.add(surfaces_.back());
  }
  coarse_scene.commit();
  scene_.commit();
  for (std::size_t i = 0; i < garments.size(); ++i) {
    const bool turned = recipe.placements[i].cosine != 1.0f;
    std::vector<Irradiance> light(coarse[i].position.size());
    for (std::size_t v = 0; v < light.size(); ++v) {
      const Vec3 &p = coarse[i].position[v], &n = coarse[i].normal[v];
      const SkyMask blocked = turned ? sky_mask(coarse_scene, p, n) : garments[i]->blocked[v];
      light[v] = irradiance(recipe.lighting, coarse_scene, p, n, blocked, true);
    }
    interpolate_new(light, garments[i]->parents);
    light_.push_back(std::move(light));
  }

  // The table's light on a grid over everything in view.
  const Vec3 up(0.0f, 0.0f, 1.0f);
  Vec2 low = Vec2::Constant(1e9f), high = Vec2::Constant(-1e9f);
  for (const double u : {-0.5, recipe.camera.width - 0.5}) {
    for (const double v : {-0.5, recipe.camera.height - 0.5}) {
      const Vec3 d = ray(u, v);
      const Vec3 p = recipe.pose.origin - d * (recipe.pose.origin.z() / d.z());
      low = low.cwiseMin(p.head<2>());
      high = high.cwiseMax(p.head<2>());
    }
  }
  grid_origin_ = low - Vec2::Constant(0.03f);
  const Vec2 size = (high - low + Vec2::Constant(0.06f)) / kGrid_m;
  const int columns = std::clamp(2 + static_cast<int>(size.x()), 2, 600);
  const int rows = std::clamp(2 + static_cast<int>(size.y()), 2, 600);
  table_light_ = cv::Mat(rows, columns, CV_32FC3, cv::Scalar::all(0));
  table_gloss_ = table_light_.clone();
  cv::Mat covered(rows, columns, CV_8UC1, cv::Scalar(0));
  Vec2 near_low = Vec2::Constant(1e9f), near_high = Vec2::Constant(-1e9f);
  for (const auto& s : coarse) {
    for (const auto& p : s.position) {
      near_low = near_low.cwiseMin(p.head<2>());
      near_high = near_high.cwiseMax(p.head<2>());
    }
  }
  near_low -= Vec2::Constant(kShadowReach_m);
  near_high += Vec2::Constant(kShadowReach_m);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const Vec2 p = grid_origin_ + kGrid_m * Vec2(static_cast<float>(x), static_cast<float>(y));
      const Vec3 point(p.x(), p.y(), recipe.table.height_m(p));
      const bool near = (p - near_low).minCoeff() > 0.0f && (near_high - p).minCoeff() > 0.0f;
      SkyMask blocked = 0;
      if (near) {
        if (coarse_scene.occluded(point, up, 0.0f, 1.0f)) {
          covered.at<std::uint8_t>(y, x) = 255;
          continue;
        }
        blocked = sky_mask(coarse_scene, point, up);
      }
      const Vec3 light =
          irradiance(recipe.lighting, coarse_scene, point, up, blocked, near).value[0];
      const Vec3 gloss =
          recipe.table.gloss > 0.0f
              ? Vec3(recipe.table.gloss * table_gloss(recipe.lighting, point, recipe.pose.origin,
                                                      recipe.table.gloss_exponent))
              : Vec3(Vec3::Zero());
      for (int c = 0; c < 3; ++c) {
        table_light_.at<cv::Vec3f>(y, x)[c] = light[c];
        table_gloss_.at<cv::Vec3f>(y, x)[c] = gloss[c];
      }
    }
  }
  // Nodes under the cloth take the light of their neighbours, so that thin cloth has no dark seam;
  // the others are averaged once, or nodes that happen to touch the cloth show as beads.
  for (int round = 0; round < 5; ++round) {
    const cv::Mat before = covered.clone();
    const cv::Mat light_before = table_light_.clone(), gloss_before = table_gloss_.clone();
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        if (round > 0 && before.at<std::uint8_t>(y, x) == 0) continue;
        cv::Vec3f light(0, 0, 0), gloss(0, 0, 0);
        int count = 0;
        for (int j = std::max(0, y - 1); j <= std::min(rows - 1, y + 1); ++j) {
          for (int i = std::max(0, x - 1); i <= std::min(columns - 1, x + 1); ++i) {
            if (before.at<std::uint8_t>(j, i) != 0) continue;
            light += light_before.at<cv::Vec3f>(j, i);
            gloss += gloss_before.at<cv::Vec3f>(j, i);
            ++count;
          }
        }
        if (count == 0) continue;
        table_light_.at<cv::Vec3f>(y, x) = light / count;
        table_gloss_.at<cv::Vec3f>(y, x) = gloss / count;
        covered.at<std::uint8_t>(y, x) = 0;
      }
    }
  }
}

ViewScene::~ViewScene() = default;

Vec3 ViewScene::ray(double u_px, double v_px) const {
  const auto& c = recipe_.camera;
  return recipe_.pose.forward + recipe_.pose.right * static_cast<float>((u_px - c.cx) / c.fx) +
         recipe_.pose.down * static_cast<float>((v_px - c.cy) / c.fy);
}

float ViewScene::table_distance(const Vec3& d, bool& floor) const {
  const Vec3& o = recipe_.pose.origin;
  float t = -o.z() / d.z();
  for (int i = 0; i < 2; ++i) {
    t = (recipe_.table.height_m((o + t * d).head<2>()) - o.z()) / d.z();
  }
  floor = !recipe_.table.on_table((o + t * d).head<2>());
  return floor ? (recipe_.table.floor_m - o.z()) / d.z() : t;
}

Vec3 ViewScene::shade_table(const Vec3& p, bool floor) const {
  if (floor)
    return recipe_.table.floor_albedo(p.head<2>()).cwiseProduct(recipe_.lighting.sky_base) * 1.2f;
  const Vec2 node = (p.head<2>() - grid_origin_) / kGrid_m;
  return recipe_.table.albedo(p.head<2>()).cwiseProduct(bilinear(table_light_, node)) +
         bilinear(table_gloss_, node);
}

IdealImages ViewScene::render(int samples) const {
  const int width = recipe_.camera.width, height = recipe_.camera.height;
  const Vec3& origin = recipe_.pose.origin;
  IdealImages out;
  out.radiance = cv::Mat(height, width, CV_32FC3);
  out.depth_m = cv::Mat(height, width, CV_32FC1);
  out.cosine = cv::Mat(height, width, CV_32FC1);
  out.object = cv::Mat(height, width, CV_8UC1, cv::Scalar(0));
  out.parts = cv::Mat(height, width, CV_32SC1, cv::Scalar(0));
  out.inside = cv::Mat(height, width, CV_8UC1, cv::Scalar(0));
  out.shadow = cv::Mat(height, width, CV_8UC1, cv::Scalar(0));
  // A mirrored picture has its projector on the other side.
  const Vec3 projector =
      origin + recipe_.pose.right * (recipe_.depth.projector_sign *
                                     (recipe_.mirrored ? -1.0f : 1.0f) * recipe_.depth.baseline_m);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      Vec3 sum = Vec3::Zero();
      for (int j = 0; j < samples; ++j) {
        for (int i = 0; i < samples; ++i) {
          const Vec3 d = ray(x - 0.5 + (i + 0.5) / samples, y - 0.5 + (j + 0.5) / samples);
          bool floor = false;
          const float table = table_distance(d, floor);
          const RayHit hit = scene_.intersect(origin, d, 0.0f, table);
          sum +=
              hit.object >= 0
                  ? cloth_radiance(*garments_[at(hit.object)], surfaces_[at(hit.object)],
                                   recipe_.fabrics[at(hit.object)], light_[at(hit.object)], hit, d)
                  : shade_table(origin + table * d, floor);
        }
      }
      sum /= static_cast<float>(samples * samples);
      out.radiance.at<cv::Vec3f>(y, x) = cv::Vec3f(sum.x(), sum.y(), sum.z());

      const Vec3 d = ray(x, y);
      bool floor = false;
      float z = table_distance(d, floor);
      Vec3 normal(0.0f, 0.0f, 1.0f);
      const RayHit hit = scene_.intersect(origin, d, 0.0f, z);
      if (hit.object >= 0) {
        const auto object = at(hit.object);
        const Surface& s = surfaces_[object];
        const Triangle triangle(s, hit);
        const int panel = s.panel_of_face[at(hit.face)];
        const PanelMap& map = garments_[object]->maps[at(panel)];
        const Vec2 p = triangle.blend(s.pattern);
        normal = triangle.blend(s.normal).normalized();
        const Fabric& fabric = recipe_.fabrics[object];
        const auto material = static_cast<Material>(map.outside.at<std::uint8_t>(map.texel(p)));
        const float ease = fabric.ease(material, garments_[object]->simulation.panels[at(panel)]);
        const float raised = 0.001f * (map.height_at(p) + fabric.relief_mm(panel, p, ease));
        z = hit.distance + raised * normal.dot(recipe_.pose.forward);
        out.object.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(hit.object + 1);
        out.parts.at<int>(y, x) = map.parts.at<int>(map.texel(p));
        if (hit.geometric_normal.dot(d) > 0.0f) out.inside.at<std::uint8_t>(y, x) = 255;
      }
      out.depth_m.at<float>(y, x) = z;
      out.cosine.at<float>(y, x) = std::abs(normal.dot(d)) / d.norm();
      const Vec3 point = origin + d * (z - 0.004f);
      const Vec3 way = projector - point;
      if (scene_.occluded(point, way, 0.0f, 1.0f)) out.shadow.at<std::uint8_t>(y, x) = 255;
    }
  }
  if (recipe_.contact > 0.0f) {
    add_contact_shadows(out.depth_m, static_cast<float>(recipe_.camera.fx), recipe_.contact,
                        out.radiance);
  }
  if (recipe_.mirrored) {
    for (cv::Mat* image : {&out.radiance, &out.depth_m, &out.cosine, &out.object, &out.parts,
                           &out.inside, &out.shadow}) {
      cv::flip(*image, *image, 1);
    }
  }
  return out;
}

std::vector<PartVisibility> ViewScene::part_visibility(std::size_t object) const {
  const Surface& s = surfaces_[object];
  const Garment& g = *garments_[object];
  const Vec3& origin = recipe_.pose.origin;
  const auto& camera = recipe_.camera;
  std::vector<PartVisibility> out(g.simulation.parts.size());
  for (std::size_t f = 0; f < s.faces.size(); ++f) {
    const auto [a, b, c] = s.faces[f];
    const PanelMap& map = g.maps[s.panel_of_face[f]];
    const Vec2 pattern = (s.pattern[at(a)] + s.pattern[at(b)] + s.pattern[at(c)]) / 3.0f;
    const int bits = map.parts.at<int>(map.texel(pattern));
    if (bits == 0) continue;
    const Vec3 p = (s.position[at(a)] + s.position[at(b)] + s.position[at(c)]) / 3.0f;
    const Vec3 cross =
        (s.position[at(b)] - s.position[at(a)]).cross(s.position[at(c)] - s.position[at(a)]);
    const double area = 0.5 * static_cast<double>(cross.norm());
    const Vec3 way = origin - p;
    const bool seen = !scene_.occluded(p + way * (0.0005f / way.norm()), way, 0.0f, 1.0f);
    const bool outside = cross.dot(way) > 0.0f;
    const float z = -way.dot(recipe_.pose.forward);
    const double u = camera.cx - camera.fx * static_cast<double>(way.dot(recipe_.pose.right) / z);
    const double v = camera.cy - camera.fy * static_cast<double>(way.dot(recipe_.pose.down) / z);
    const bool framed = u > -0.5 && v > -0.5 && u < camera.width - 0.5 && v < camera.height - 0.5;
    for (std::size_t i = 0; i < out.size(); ++i) {
      if ((bits >> i & 1) == 0) continue;
      out[i].total += area;
      if (!seen) continue;
      (framed ? (outside ? out[i].seen_outside : out[i].seen_inside) : out[i].seen_beyond_frame) +=
          area;
    }
  }
  return out;
}

}  // namespace weft::synth
