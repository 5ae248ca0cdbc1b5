#include "synth/pattern_maps.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace weft::synth {
namespace {

constexpr int kShift = 4;           // sub-texel bits of OpenCV's drawing
constexpr float kTexel = 0.0005f;   // about a third of a camera pixel
constexpr double kMaxTexels = 4e6;  // of a panel; blankets get coarser texels

class Painter {
 public:
  Painter(PanelMap& map, std::uint32_t seed)
      : map_(map), seed_(seed), raise_(map.outside.size(), CV_32FC1, cv::Scalar(0)) {}

  cv::Point fixed(const Vec2& p) const {
    const Vec2 t = (p - map_.origin) / map_.texel_m * static_cast<float>(1 << kShift);
    const Vec2 c = t.cwiseMax(-2e6f).cwiseMin(2e6f);
    return {cvRound(c.x()), cvRound(c.y())};
  }
  int texels(float metres) const { return std::max(1, cvRound(metres / map_.texel_m)); }

  void fill(cv::Mat& image, const std::vector<Vec2>& polygon, const cv::Scalar& value) const {
    std::vector<cv::Point> points;
    for (const auto& p : polygon) points.push_back(fixed(p));
    const cv::Point* data = points.data();
    const int count = static_cast<int>(points.size());
    cv::fillPoly(image, &data, &count, 1, value, cv::LINE_8, kShift);
  }
  void stroke(cv::Mat& image, const std::vector<Vec2>& line, float width_m,
              const cv::Scalar& value) const {
    for (std::size_t i = 0; i + 1 < line.size(); ++i) {
      cv::line(image, fixed(line[i]), fixed(line[i + 1]), value, std::min(texels(width_m), 32000),
               cv::LINE_8, kShift);
    }
  }
  void disc(cv::Mat& image, const Vec2& centre, float radius_m, const cv::Scalar& value) const {
    cv::circle(image, fixed(centre), static_cast<int>(radius_m / map_.texel_m * (1 << kShift)),
               value, cv::FILLED, cv::LINE_8, kShift);
  }
  void raise(const cv::Mat& mask, float millimetres) {
    cv::add(raise_, cv::Scalar(millimetres), raise_, mask);
  }
  void raise_line(const std::vector<Vec2>& line, float width_m, float millimetres) {
    cv::Mat mask(raise_.size(), CV_8UC1, cv::Scalar(0));
    stroke(mask, line, width_m, cv::Scalar(255));
    raise(mask, millimetres);
  }

  void piece(const Feature& f, Material material, float default_mm) {
    const cv::Scalar value(static_cast<double>(material));
    if (!f.inside) fill(map_.outside, f.points, value);
    if (f.inside) fill(map_.inside, f.points, value);
    cv::Mat mask(raise_.size(), CV_8UC1, cv::Scalar(0));
    fill(mask, f.points, cv::Scalar(255));
    raise(mask,
          (f.inside ? -1.0f : 1.0f) * (f.height_m != 0.0f ? f.height_m * 1000.0f : default_mm));
  }

  void label(const Feature& f) {
    piece(f, Material::kLabel, 0.4f);
    Vec2 low = f.points[0], high = f.points[0];
    for (const auto& p : f.points) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    cv::Mat& image = f.inside ? map_.inside : map_.outside;
    const Vec2 size = high - low;
    const int rows = 1 + static_cast<int>(hash01(0, 0, seed_) * 5.0f);
    for (int row = 0; row < rows; ++row) {  // marks of about the size of letters
      const float h = 0.45f * size.y() / static_cast<float>(rows);
      const float y =
          low.y() + (static_cast<float>(row) + 0.28f) * size.y() / static_cast<float>(rows);
      float x = low.x() + size.x() * 0.12f;
      for (int i = 0; x < high.x() - size.x() * 0.15f && i < 40; ++i) {
        const float w = h * (0.25f + 0.5f * hash01(i, row, seed_ + 1));
        fill(image, {{x, y}, {x + w, y}, {x + w, y + h}, {x, y + h}},
             cv::Scalar(static_cast<double>(Material::kLabelText)));
        x += w + h * (0.15f + 0.5f * hash01(i, row, seed_ + 2));
      }
    }
  }

  /// A row of thread with its groove; the cloth puckers beside it.
  void stitch(const std::vector<Vec2>& line, float offset_m) {
    float phase = 0.0f, pucker = 0.0f;
    int count = 0;
    constexpr float kDash = 0.0024f, kPeriod = 0.0030f;
    for (std::size_t i = 0; i + 1 < line.size(); ++i) {
      const Vec2 way = line[i + 1] - line[i];
      const float length = way.norm();
      if (length < 1e-6f) continue;
      const Vec2 along = way / length, across(-along.y(), along.x());
      const Vec2 start = line[i] + offset_m * across;
      stroke(groove_, {start, start + way}, 0.0012f, cv::Scalar(-0.45));
      float s = -phase;
      for (; s < length; s += kPeriod) {
        const float a = std::max(0.0f, s), b = std::min(length, s + kDash);
        if (b <= a) continue;
        for (cv::Mat* image : {&map_.outside, &map_.inside}) {
          stroke(*image, {start + a * along, start + b * along}, 0.0006f,
                 cv::Scalar(static_cast<double>(Material::kThread)));
        }
      }
      phase = length - (s - kPeriod);
      for (; pucker < length; ++count) {
        const Vec2 at = start + pucker * along;
        const float reach = 0.003f + 0.004f * hash01(count, 3, seed_);
        const float depth = -0.6f * hash01(count, 4, seed_);
        stroke(pucker_, {at - reach * across, at + reach * across}, 0.002f, cv::Scalar(depth));
        pucker += 0.006f + 0.008f * hash01(count, 5, seed_);
      }
      pucker -= length;
    }
  }

  void begin_stitches() {
    groove_ = cv::Mat(raise_.size(), CV_32FC1, cv::Scalar(0));
    pucker_ = groove_.clone();
  }

  /// Ridges of a knit band, across its edge.
  void ribs(const Feature& f) {
    float next = 0.0f;
    constexpr float kPeriod = 0.0026f;
    for (std::size_t i = 0; i + 1 < f.points.size(); ++i) {
      const Vec2 way = f.points[i + 1] - f.points[i];
      const float length = way.norm();
      if (length < 1e-6f) continue;
      const Vec2 along = way / length, across(-along.y(), along.x());
      for (; next < length; next += kPeriod) {
        const Vec2 at = f.points[i] + next * along;
        stroke(groove_, {at - f.width_m * across, at + f.width_m * across}, 0.001f,
               cv::Scalar(-0.35));
      }
      next -= length;
    }
  }

  void finish() {
    const auto radius = [&](float metres) { return std::max(1, cvRound(metres / map_.texel_m)); };
    box_blur(raise_, radius(0.0007f), 2);
    box_blur(groove_, radius(0.0005f), 2);
    box_blur(pucker_, radius(0.0015f), 2);
    cv::Mat around = raise_.clone();
    box_blur(around, radius(0.0015f), 2);
    for (int y = 0; y < raise_.rows; ++y) {
      const float *raised = raise_.ptr<float>(y), *wide = around.ptr<float>(y);
      const float *groove = groove_.ptr<float>(y), *pucker = pucker_.ptr<float>(y);
      float* height = map_.height_mm.ptr<float>(y);
      auto* crevice = map_.crevice.ptr<std::uint8_t>(y);
      for (int x = 0; x < raise_.cols; ++x) {
        height[x] = raised[x] + groove[x] + pucker[x];
        const float sunk = std::max(0.0f, wide[x] - raised[x]) * 0.7f - 0.5f * groove[x];
        crevice[x] = static_cast<std::uint8_t>(255.0f * std::clamp(1.0f - sunk, 0.35f, 1.0f));
      }
    }
  }

 private:
  PanelMap& map_;
  std::uint32_t seed_;
  cv::Mat raise_, groove_, pucker_;
};

}  // namespace

cv::Point PanelMap::texel(const Vec2& p) const {
  const Vec2 t = (p - origin) / texel_m;
  return {std::clamp(floor_int(t.x() + 0.5f), 0, outside.cols - 1),
          std::clamp(floor_int(t.y() + 0.5f), 0, outside.rows - 1)};
}

float PanelMap::height_at(const Vec2& p) const {
  const Vec2 t = (p - origin) / texel_m;
  const float x = std::clamp(t.x(), 0.0f, static_cast<float>(outside.cols - 2));
  const float y = std::clamp(t.y(), 0.0f, static_cast<float>(outside.rows - 2));
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
  const float *a = height_mm.ptr<float>(iy) + ix, *b = height_mm.ptr<float>(iy + 1) + ix;
  return (a[0] + (a[1] - a[0]) * fx) * (1.0f - fy) + (b[0] + (b[1] - b[0]) * fx) * fy;
}

void box_blur(cv::Mat& image, int radius, int times) {
  std::vector<float> line;
  const auto pass = [&](float* data, int count, std::ptrdiff_t step) {
    line.resize(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) line[static_cast<std::size_t>(i)] = data[i * step];
    const auto value = [&](int i) {
      return static_cast<double>(line[static_cast<std::size_t>(std::clamp(i, 0, count - 1))]);
    };
    double sum = 0.0;
    for (int i = -radius; i <= radius; ++i) sum += value(i);
    for (int i = 0; i < count; ++i) {
      data[i * step] = static_cast<float>(sum / (2 * radius + 1));
      sum += value(i + radius + 1) - value(i - radius);
    }
  };
  for (int t = 0; t < times; ++t) {
    for (int y = 0; y < image.rows; ++y) pass(image.ptr<float>(y), image.cols, 1);
    const auto step = static_cast<std::ptrdiff_t>(image.step1());
    for (int x = 0; x < image.cols; ++x) pass(image.ptr<float>(0) + x, image.rows, step);
  }
}

std::vector<PanelMap> make_panel_maps(const Simulation& s) {
  std::vector<PanelMap> maps(s.panels.size());
  std::vector<Vec2> low(maps.size(), Vec2::Constant(1e9f)),
      high(maps.size(), Vec2::Constant(-1e9f));
  for (std::size_t f = 0; f < s.faces.size(); ++f) {
    for (const int v : s.faces[f]) {
      const Vec2& p = s.pattern[static_cast<std::size_t>(v)];
      low[s.panel_of_face[f]] = low[s.panel_of_face[f]].cwiseMin(p);
      high[s.panel_of_face[f]] = high[s.panel_of_face[f]].cwiseMax(p);
    }
  }
  for (std::size_t i = 0; i < maps.size(); ++i) {
    PanelMap& map = maps[i];
    if (low[i].x() > high[i].x()) low[i] = high[i] = Vec2::Zero();  // a panel without faces
    const Vec2 size = high[i] - low[i] + Vec2::Constant(0.008f);
    map.texel_m = std::max(kTexel, static_cast<float>(std::sqrt(static_cast<double>(size.x()) *
                                                                size.y() / kMaxTexels)));
    map.origin = low[i] - Vec2::Constant(0.004f);
    const cv::Size texels(2 + static_cast<int>(size.x() / map.texel_m),
                          2 + static_cast<int>(size.y() / map.texel_m));
    map.outside = cv::Mat(texels, CV_8UC1, cv::Scalar(0));
    map.inside = map.outside.clone();
    map.height_mm = cv::Mat(texels, CV_32FC1, cv::Scalar(0));
    map.crevice = cv::Mat(texels, CV_8UC1, cv::Scalar(255));
    map.parts = cv::Mat(texels, CV_32SC1, cv::Scalar(0));

    const int panel = static_cast<int>(i);
    Painter paint(map, static_cast<std::uint32_t>(s.seed * 977 + s.index * 31 + panel));
    paint.begin_stitches();
    const auto each = [&](std::initializer_list<const char*> kinds, const auto& draw) {
      for (const auto& f : s.features) {
        for (const char* kind : kinds) {
          if (f.panel == panel && f.kind == kind) draw(f);
        }
      }
    };
    // From the cloth upwards.
    each({"yoke"}, [&](const Feature& f) { paint.piece(f, Material::kYoke, 0.5f); });
    each({"pocket"}, [&](const Feature& f) { paint.piece(f, Material::kPocket, 0.9f); });
    each({"fly"}, [&](const Feature& f) { paint.piece(f, Material::kFly, 1.0f); });
    each({"placket"}, [&](const Feature& f) { paint.piece(f, Material::kPlacket, 1.0f); });
    each({"waistband"}, [&](const Feature& f) { paint.piece(f, Material::kWaistband, 1.3f); });
    each({"hem", "rib"}, [&](const Feature& f) {
      const auto material = f.kind == "hem" ? Material::kHem : Material::kRib;
      for (cv::Mat* image : {&map.outside, &map.inside}) {
        paint.stroke(*image, f.points, 2 * f.width_m, cv::Scalar(static_cast<double>(material)));
      }
      paint.raise_line(f.points, 2 * f.width_m, 0.7f);
      if (f.kind == "rib") paint.ribs(f);
    });
    each({"belt-loop"}, [&](const Feature& f) { paint.piece(f, Material::kBeltLoop, 2.0f); });
    each({"label"}, [&](const Feature& f) { paint.label(f); });
    each({"stitch"}, [&](const Feature& f) { paint.stitch(f.points, f.offset_m); });
    each({"twin-stitch"}, [&](const Feature& f) {
      paint.stitch(f.points, 0.5f * f.offset_m);
      paint.stitch(f.points, -0.5f * f.offset_m);
    });
    each({"cord"}, [&](const Feature& f) {
      const float width = std::max(0.003f, f.width_m);
      paint.stroke(map.outside, f.points, width, cv::Scalar(static_cast<double>(Material::kCord)));
      paint.raise_line(f.points, width, 2.5f);
    });
    each({"button", "rivet"}, [&](const Feature& f) {
      const bool button = f.kind == "button";
      const float radius = std::max(0.002f, f.radius_m);
      cv::Mat mask(texels, CV_8UC1, cv::Scalar(0));
      paint.disc(mask, f.points[0], radius, cv::Scalar(255));
      paint.raise(mask, button ? 1.6f : 0.9f);
      paint.disc(map.outside, f.points[0], radius,
                 cv::Scalar(static_cast<double>(button ? Material::kButton : Material::kRivet)));
      if (!button) return;
      mask = cv::Scalar(0);
      paint.disc(mask, f.points[0], 0.7f * radius, cv::Scalar(255));
      paint.raise(mask, -0.6f);
      for (const float dx : {-1.0f, 1.0f}) {
        for (const float dy : {-1.0f, 1.0f}) {
          paint.disc(map.outside, f.points[0] + Vec2(dx, dy) * 0.22f * radius, 0.12f * radius,
                     cv::Scalar(static_cast<double>(Material::kButtonHole)));
        }
      }
    });
    paint.finish();

    for (std::size_t p = 0; p < s.parts.size(); ++p) {
      cv::Mat mask(texels, CV_8UC1, cv::Scalar(0));
      for (const auto& region : s.parts[p].regions) {
        if (region.panel != panel) continue;
        if (region.is_line) {
          paint.stroke(mask, region.points, 2 * region.width_m, cv::Scalar(255));
        } else {
          paint.fill(mask, region.points, cv::Scalar(255));
        }
      }
      cv::bitwise_or(map.parts, cv::Scalar(1 << p), map.parts, mask);
    }
  }
  return maps;
}

}  // namespace weft::synth
