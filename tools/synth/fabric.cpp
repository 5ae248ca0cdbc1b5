#include "synth/fabric.hpp"

#include <algorithm>
#include <cmath>

namespace weft::synth {
namespace {

bool reserved_hue(double hue) { return hue > 0.76 && hue < 0.9; }

Vec3 draw_colour(Random& r, bool held_out_hue) {
  double hue = r.uniform();
  if (held_out_hue) {
    hue = r.uniform(0.77, 0.89);
  } else {
    while (reserved_hue(hue)) hue = r.uniform();
  }
  const double kind = r.uniform();
  double value, saturation = r.uniform() < 0.4 ? r.uniform(0.0, 0.2) : r.uniform(0.2, 0.85);
  if (held_out_hue) saturation = r.uniform(0.35, 0.85);
  if (kind < 0.2) {
    value = r.uniform(0.07, 0.16);
    saturation = std::min(saturation, 0.5);
  } else if (kind < 0.38) {
    value = r.uniform(0.16, 0.34);
  } else if (kind < 0.68) {
    value = r.uniform(0.34, 0.66);
  } else if (kind < 0.87) {
    value = r.uniform(0.62, 0.86);
  } else {
    value = r.uniform(0.82, 0.96);
    if (!held_out_hue) saturation = r.uniform(0.0, 0.12);
  }
  return colour_from_hsv(hue, saturation, value);
}

Vec3 mix(const Vec3& a, const Vec3& b, float t) { return a + (b - a) * t; }
Vec3 grey(float v) { return Vec3::Constant(v); }

bool is_leaf(const Panel& p) { return p.name.find("collar") != std::string::npos; }
bool is_collar(const Panel& p) { return is_leaf(p) || p.name.find("hood") != std::string::npos; }

bool is_stiff(Material m) {
  return m == Material::kRib || m == Material::kPlacket || m == Material::kWaistband ||
         m == Material::kHem || m == Material::kBeltLoop || m == Material::kFly;
}

}  // namespace

Fabric draw_fabric(Random& r, bool held_out, const Vec3& near, const Simulation& s) {
  Fabric f;
  f.held_out = held_out;
  f.seed = static_cast<std::uint32_t>(r.bits());
  const bool reserved_family = held_out && r.uniform() < 0.6;
  if (reserved_family) {
    constexpr const char* kReserved[] = {"plaid", "dots", "herringbone"};
    f.family = kReserved[r.below(3)];
  } else {
    constexpr std::pair<const char*, double> kFamilies[] = {
        {"plain", 0.27}, {"melange", 0.16}, {"stripes", 0.12}, {"pinstripe", 0.05}, {"logo", 0.11},
        {"print", 0.08}, {"denim", 0.1},    {"knit", 0.07},    {"camouflage", 0.04}};
    double pick = r.uniform();
    for (const auto& [name, share] : kFamilies) {
      f.family = name;
      if ((pick -= share) < 0.0) break;
    }
  }
  f.base = draw_colour(r, held_out && !reserved_family);
  if (r.uniform() < 0.08) {  // low contrast
    f.base = near * static_cast<float>(r.uniform(0.75, 1.2));
    f.base = f.base.cwiseMin(0.85f);
  }
  f.second = r.uniform() < 0.5 ? draw_colour(r, false)
                               : Vec3(f.base * static_cast<float>(r.uniform(0.3, 1.8)));
  f.second = f.second.cwiseMin(0.9f);
  f.third = draw_colour(r, false);
  f.trim = r.uniform() < 0.5 ? f.second : draw_colour(r, false);
  const float light = luminance(f.base);
  const bool contrast_thread = r.uniform() < 0.4;
  if (contrast_thread) {
    const double kind = r.uniform();
    f.thread =
        kind < 0.45
            ? colour_from_hsv(r.uniform(0.06, 0.13), r.uniform(0.4, 0.85), r.uniform(0.45, 0.85))
        : kind < 0.7 ? colour_from_hsv(r.uniform(), r.uniform(0.0, 0.1), r.uniform(0.7, 0.95))
                     : draw_colour(r, false);
  } else {
    f.thread = f.base * static_cast<float>(r.uniform(0.7, 1.25));
  }
  f.thread = mix(f.base, f.thread, static_cast<float>(r.uniform(0.4, 0.9)));
  const double button = r.uniform();
  f.button = button < 0.35   ? Vec3(f.base * static_cast<float>(r.uniform(0.5, 1.6)))
             : button < 0.7  ? colour_from_hsv(0.1, r.uniform(0.0, 0.15), r.uniform(0.75, 0.95))
             : button < 0.85 ? colour_from_hsv(0.08, 0.5, r.uniform(0.15, 0.45))
                             : draw_colour(r, false);
  f.button = f.button.cwiseMin(0.85f);
  f.metal = r.uniform() < 0.5 ? colour_from_hsv(0.07, r.uniform(0.3, 0.6), r.uniform(0.5, 0.8))
                              : colour_from_hsv(0.6, 0.05, r.uniform(0.5, 0.85));
  const bool dark_label = r.uniform() < 0.5;
  f.label =
      dark_label ? draw_colour(r, false) * 0.3f : grey(static_cast<float>(r.uniform(0.6, 0.85)));
  f.label_text = dark_label ? grey(0.75f) : grey(static_cast<float>(r.uniform(0.03, 0.25)));
  f.cord = r.uniform() < 0.5 ? f.base * 1.1f : draw_colour(r, false);
  if (r.uniform() < 0.35) {
    for (const auto m : {Material::kRib, Material::kPlacket, Material::kPocket, Material::kYoke,
                         Material::kWaistband, Material::kBeltLoop, Material::kHem}) {
      if (r.uniform() < 0.4) f.trimmed |= 1u << static_cast<int>(m);
    }
    f.collar_trimmed = r.uniform() < 0.5;
  }
  f.weave = static_cast<float>(power(10.0, r.uniform(-2.4, -1.15)));
  f.strength = static_cast<float>(r.uniform(0.25, 1.0));
  f.scale_m = static_cast<float>(power(10.0, r.uniform(-2.3, -1.25)));
  const double angle =
      r.uniform() < 0.7 ? 0.5 * kPi * static_cast<double>(r.below(2)) : r.uniform(0.0, kPi);
  f.angle_sine = static_cast<float>(sine(angle));
  f.angle_cosine = static_cast<float>(cosine(angle));
  f.mottle = static_cast<float>(r.uniform() < 0.5 ? r.uniform(0.0, 0.05) : r.uniform(0.05, 0.3));
  f.wrinkle_scale_m =
      static_cast<float>(r.uniform() < 0.5 ? r.uniform(0.009, 0.02) : r.uniform(0.02, 0.06));
  f.wrinkle_stretch = static_cast<float>(r.uniform(1.5, 6.0));
  const double highest_mm = std::min(2.2, 70.0 * static_cast<double>(f.wrinkle_scale_m));
  f.wrinkle_mm = static_cast<float>(r.uniform() < 0.25 ? 0.0 : r.uniform(0.2, highest_mm));
  const double turn = r.uniform(0.0, kPi);
  f.wrinkle_sine = static_cast<float>(sine(turn));
  f.wrinkle_cosine = static_cast<float>(cosine(turn));
  f.crease_mm = static_cast<float>(r.uniform() < 0.7 ? 0.0 : r.uniform(0.3, 1.2));
  f.crease_spacing_m = static_cast<float>(r.uniform(0.12, 0.3));
  f.seam_relief = static_cast<float>(r.uniform(0.25, 1.1));
  f.sheen = static_cast<float>(r.uniform(0.0, 0.06));
  f.gloss = static_cast<float>(r.uniform() < 0.8 ? r.uniform(0.0, 0.02) : r.uniform(0.02, 0.1));

  const double inner = r.uniform();
  f.inside = f.base * static_cast<float>(r.uniform(0.8, 1.1));
  if (f.family == "denim" || inner < 0.18) {
    f.inside = mix(f.base, grey(static_cast<float>(r.uniform(0.2, 0.6))),
                   static_cast<float>(r.uniform(0.25, 0.7)));
  } else if (inner < 0.26) {
    f.inside = draw_colour(r, false);
  }
  if (light < 0.03 && r.uniform() < 0.2)
    f.infrared_loss = static_cast<float>(r.uniform(0.02, 0.35));

  if (f.family == "melange") {
    f.second =
        mix(f.base, r.uniform() < 0.6 ? grey(static_cast<float>(r.uniform(0.02, 0.7))) : f.second,
            0.6f);
    f.scale_m = static_cast<float>(r.uniform(0.004, 0.014));
    f.strength = static_cast<float>(r.uniform(0.15, 0.75));
  } else if (f.family == "denim") {
    if (r.uniform() < 0.5) {
      f.base = colour_from_hsv(r.uniform(0.56, 0.66), r.uniform(0.3, 0.75), r.uniform(0.12, 0.65));
    }
    f.second = mix(f.base, grey(0.6f), static_cast<float>(r.uniform(0.1, 0.35)));
    f.scale_m = static_cast<float>(r.uniform(0.0014, 0.0024));
    f.mottle = static_cast<float>(r.uniform(0.0, 0.5));
  } else if (f.family == "knit") {
    f.scale_m = static_cast<float>(r.uniform(0.0025, 0.007));
    f.second = f.base * static_cast<float>(r.uniform(0.5, 0.85));
  } else if (f.family == "pinstripe") {
    f.scale_m = static_cast<float>(r.uniform(0.006, 0.025));
  } else if (f.family == "print" || f.family == "dots" || f.family == "camouflage") {
    f.scale_m = static_cast<float>(r.uniform(0.012, 0.07));
  } else if (f.family == "herringbone") {
    f.scale_m = static_cast<float>(r.uniform(0.006, 0.02));
  } else if (f.family == "logo") {
    int panel = 0;
    for (std::size_t i = 0; i < s.panels.size(); ++i) {
      if (s.panels[i].side == (r.uniform() < 0.75 ? "front" : "back") && s.panels[i].layer == 0) {
        panel = static_cast<int>(i);
        break;
      }
    }
    Vec2 low = Vec2::Constant(1e9f), high = Vec2::Constant(-1e9f);
    for (std::size_t i = 0; i < s.faces.size(); ++i) {
      if (s.panel_of_face[i] != panel) continue;
      low = low.cwiseMin(s.pattern[static_cast<std::size_t>(s.faces[i][0])]);
      high = high.cwiseMax(s.pattern[static_cast<std::size_t>(s.faces[i][0])]);
    }
    const Vec2 centre = mix(Vec3(low.x(), low.y(), 0), Vec3(high.x(), high.y(), 0),
                            static_cast<float>(r.uniform(0.4, 0.75)))
                            .head<2>();
    const auto span =
        static_cast<float>(r.uniform() < 0.3 ? r.uniform(0.015, 0.05) : r.uniform(0.05, 0.14));
    const Vec2 middle(0.5f * (low.x() + high.x()) + static_cast<float>(r.uniform(-0.1, 0.1)),
                      centre.y());
    const auto count = r.integer(1, 9);
    for (int i = 0; i < count; ++i) {
      Print p;
      p.shape = static_cast<Print::Shape>(r.below(4));
      p.panel = panel;
      p.centre = middle + span * Vec2(static_cast<float>(r.uniform(-0.6, 0.6)),
                                      static_cast<float>(r.uniform(-0.8, 0.8)));
      p.half_size = span * Vec2(static_cast<float>(r.uniform(0.2, 1.0)),
                                static_cast<float>(r.uniform(0.08, 0.7)));
      if (p.shape == Print::Shape::kLetters)
        p.half_size.y() = std::min(p.half_size.y(), 0.4f * p.half_size.x());
      p.colour = i % 2 == 0 ? f.second : f.third;
      f.prints.push_back(p);
    }
  }
  return f;
}

void draw_wear(Random& r, Fabric& f) {
  const auto u = [&](double a, double b) { return static_cast<float>(r.uniform(a, b)); };
  const auto turned = [&](float& s, float& c) {
    const double turn = r.uniform(0.0, kPi);
    s = static_cast<float>(sine(turn));
    c = static_cast<float>(cosine(turn));
  };
  const double folds = r.uniform();
  f.fold_mm = folds < 0.25 ? 0.0f : folds < 0.5 ? u(0.5, 3.0) : u(3.0, 12.0);
  f.fold_scale_m = u(0.02, 0.06);
  f.fold_stretch = u(3.0, 9.0);
  turned(f.fold_sine, f.fold_cosine);
  f.stiff_share = r.uniform() < 0.3 ? u(0.4, 1.0) : u(0.0, 0.3);
  f.plain_bands = r.uniform() < 0.5;
  f.band_tone = r.uniform() < 0.5 ? u(0.95, 1.05) : u(0.75, 1.3);
  if (f.family == "melange") {
    f.scale_m = u(0.004, 0.03);
    f.strength = u(0.2, 1.0);
  }
}

float Fabric::ease(Material material, const Panel& panel) const {
  return is_stiff(material) || is_leaf(panel) ? stiff_share : 1.0f;
}

Vec3 Fabric::albedo(Material material, const Panel& panel, int index, const Vec2& p,
                    bool is_inside) const {
  switch (material) {
    case Material::kThread:
      return thread * (is_inside ? 0.9f : 1.0f);
    case Material::kLabel:
      return label;
    case Material::kLabelText:
      return label_text;
    case Material::kButton:
      return button;
    case Material::kButtonHole:
      return button * 0.25f;
    case Material::kRivet:
      return metal;
    case Material::kCord: {
      const bool twist = ((floor_int((p.x() + p.y()) / 0.0025f)) & 1) != 0;
      return cord * (twist ? 1.0f : 0.8f);
    }
    default:
      break;
  }
  const auto offset = static_cast<std::uint32_t>(index) * 7919u;
  const float fine =
      1.0f + weave * (2.0f * noise(p.x() / 0.0009f, p.y() / 0.0009f, seed + offset) +
                      1.4f * noise(p.x() / 0.0025f, p.y() / 0.0022f, seed + offset + 1) - 1.7f);
  const float slow =
      1.0f +
      mottle * (2.0f * fractal_noise(p.x() / 0.12f, p.y() / 0.12f, 3, seed + offset + 2) - 1.0f);
  const bool trim_piece =
      (trimmed >> static_cast<int>(material) & 1u) != 0 || (collar_trimmed && is_collar(panel));
  if (is_inside) {
    const bool knit_band = material == Material::kRib;
    Vec3 c = knit_band && trim_piece ? trim : inside;
    if (family == "melange") {
      c *= 1.0f +
           0.2f * strength * (2.0f * noise(p.x() / scale_m, p.y() / 0.0012f, seed + 5) - 1.0f);
    }
    return (c * fine).cwiseMin(0.92f);
  }
  if (trim_piece) return (trim * fine).cwiseMin(0.92f);
  if (plain_bands && (material == Material::kRib || is_leaf(panel)))
    return (base * (band_tone * fine)).cwiseMin(0.92f);

  const float x = angle_cosine * p.x() + angle_sine * p.y();
  const float y = -angle_sine * p.x() + angle_cosine * p.y();
  Vec3 c = base;
  if (family == "melange") {
    const float streak = noise(x / scale_m, y / 0.0011f, seed + offset + 3) +
                         0.6f * noise(x / (0.4f * scale_m), y / 0.0018f, seed + offset + 4) - 0.8f;
    c = mix(base, second, std::clamp(0.5f + 1.4f * streak, 0.0f, 1.0f) * strength);
  } else if (family == "denim") {
    const float twill =
        noise((p.x() + p.y()) / scale_m, (p.x() - p.y()) / 0.006f, seed + offset + 3);
    const float slub = noise(p.x() / 0.0013f, p.y() / 0.05f, seed + offset + 4);
    const float worn =
        smooth_step(0.45f, 0.8f, fractal_noise(p.x() / 0.09f, p.y() / 0.3f, 2, seed + 9));
    c = mix(base, second, clamp01(strength * (0.9f * twill + 0.5f * slub - 0.35f) + mottle * worn));
  } else if (family == "knit") {
    const float column = p.x() / scale_m;
    const float inside_column = column - static_cast<float>(floor_int(column));
    const float row = p.y() / (0.75f * scale_m) + 1.2f * std::abs(inside_column - 0.5f);
    const float in_row = row - static_cast<float>(floor_int(row));
    const float shade = std::min(std::min(inside_column, 1.0f - inside_column) * 4.0f, 1.0f) *
                        std::min(std::min(in_row, 1.0f - in_row) * 4.0f, 1.0f);
    c = mix(second, base, 1.0f - strength * (1.0f - shade));
  } else if (family == "stripes" || family == "pinstripe") {
    const bool thin = family == "pinstripe";
    const float t = y / (thin ? scale_m : 2.5f * scale_m);
    const float in = t - static_cast<float>(floor_int(t));
    const float share =
        thin ? std::min(0.3f, 0.0015f / scale_m) : 0.15f + 0.4f * hash01(1, 1, seed);
    if (in < share) c = second;
    if (!thin && hash01(2, 2, seed) < 0.4f && in > 0.75f && in < 0.75f + 0.5f * share) c = third;
  } else if (family == "plaid") {
    const auto band = [&](float v, std::uint32_t k) {
      const float t = v / (3.0f * scale_m), in = t - static_cast<float>(floor_int(t));
      return (in < 0.3f ? 0.5f : 0.0f) +
             (in > 0.6f && in < 0.6f + 0.1f * hash01(3, 3, seed + k) ? 0.5f : 0.0f);
    };
    c = mix(base, second, band(x, 1));
    c = mix(c, third, band(y, 2) * 0.7f);
  } else if (family == "herringbone") {
    const int column = floor_int(x / scale_m);
    const float t = (y + ((column & 1) != 0 ? x : -x)) / (0.35f * scale_m);
    if (t - static_cast<float>(floor_int(t)) < 0.5f) c = mix(base, second, strength);
  } else if (family == "camouflage") {
    const float n = fractal_noise(p.x() / scale_m, p.y() / scale_m, 2, seed + offset + 3);
    const float m = fractal_noise(p.x() / scale_m, p.y() / scale_m, 2, seed + offset + 23);
    if (n > 0.56f) c = second;
    if (m > 0.58f) c = third;
  } else if (family == "print" || family == "dots") {
    const int cx = floor_int(p.x() / scale_m), cy = floor_int(p.y() / scale_m);
    const bool regular = family == "dots";
    for (int j = cy - 1; j <= cy + 1; ++j) {
      for (int i = cx - 1; i <= cx + 1; ++i) {
        const float jx = regular ? ((j & 1) != 0 ? 0.75f : 0.25f) : hash01(i, j, seed + 3);
        const float jy = regular ? 0.5f : hash01(i, j, seed + 4);
        const Vec2 d = p / scale_m - Vec2(static_cast<float>(i) + jx, static_cast<float>(j) + jy);
        const float radius = regular ? 0.15f + 0.2f * hash01(0, 0, seed + 5)
                                     : 0.15f + 0.35f * hash01(i, j, seed + 5);
        const float petals =
            regular ? 1.0f
                    : 0.65f + 0.7f * noise(d.x() * 5.0f + static_cast<float>(i) * 9.1f,
                                           d.y() * 5.0f + static_cast<float>(j) * 7.3f, seed + 6);
        const float distance = d.norm();
        if (distance < radius * petals) {
          c = hash01(i, j, seed + 7) < 0.6f ? second : third;
          if (!regular && distance < 0.3f * radius) c = base * 0.6f + third * 0.4f;
        }
      }
    }
  }
  for (const auto& print : prints) {
    if (print.panel != index) continue;
    const Vec2 d = (p - print.centre).cwiseQuotient(print.half_size);
    bool on = false;
    switch (print.shape) {
      case Print::Shape::kEllipse:
        on = d.squaredNorm() < 1.0f;
        break;
      case Print::Shape::kRing:
        on = d.squaredNorm() < 1.0f && d.squaredNorm() > 0.55f;
        break;
      case Print::Shape::kBox:
        on = d.cwiseAbs().maxCoeff() < 1.0f;
        break;
      case Print::Shape::kLetters: {
        if (d.cwiseAbs().maxCoeff() >= 1.0f) break;
        const float letter = (p.x() - print.centre.x()) / (0.8f * print.half_size.y());
        const int i = floor_int(letter);
        const float in = letter - static_cast<float>(i);
        const int cell_x = static_cast<int>(in * 4.0f),
                  cell_y = static_cast<int>((d.y() + 1.0f) * 2.5f);
        on = in < 0.75f && (cell_x == static_cast<int>(hash01(i, 0, seed + 8) * 3.0f) ||
                            hash01(i * 8 + cell_x, cell_y, seed + 9) < 0.45f);
        break;
      }
    }
    if (on) c = print.colour;
  }
  return (c * (fine * slow)).cwiseMax(0.002f).cwiseMin(0.92f);
}

float Fabric::relief_mm(int index, const Vec2& p, float share) const {
  const auto offset = static_cast<std::uint32_t>(index) * 7919u + seed;
  float h = 0.0f;
  if (wrinkle_mm > 0.0f) {
    const float x = (wrinkle_cosine * p.x() + wrinkle_sine * p.y()) / wrinkle_scale_m;
    const float y =
        (-wrinkle_sine * p.x() + wrinkle_cosine * p.y()) / (wrinkle_stretch * wrinkle_scale_m);
    // Ridges along a slowly turning direction, strong here and absent there.
    const float bend = 1.5f * noise(x * 0.4f, y * 0.4f, offset + 11);
    const float ridge = 2.0f * noise(x + bend, y + bend, offset + 12) - 1.0f;
    const float small = 2.0f * noise(2.3f * x - bend, 2.3f * y + bend, offset + 13) - 1.0f;
    const float where = smooth_step(0.2f, 0.65f, noise(p.x() / 0.11f, p.y() / 0.11f, offset + 14));
    h += wrinkle_mm * where * ((1.0f - std::abs(ridge)) * 1.2f + 0.5f * (1.0f - std::abs(small)));
  }
  if (fold_mm > 0.0f) {
    // Crests along the zero lines of a stretched noise, bent as gathers are.
    const float bend_x = 0.05f * noise(p.x() / 0.13f, p.y() / 0.13f, offset + 16);
    const float bend_y = 0.05f * noise(p.x() / 0.13f, p.y() / 0.13f, offset + 17);
    const float px = p.x() + bend_x, py = p.y() + bend_y;
    const float x = (fold_cosine * px + fold_sine * py) / fold_scale_m;
    const float y = (-fold_sine * px + fold_cosine * py) / (fold_stretch * fold_scale_m);
    const float crest = 1.0f - std::abs(2.0f * noise(x, y, offset + 18) - 1.0f);
    const float where = smooth_step(0.3f, 0.7f, noise(p.x() / 0.15f, p.y() / 0.15f, offset + 19));
    h += fold_mm * where * crest * crest * crest;
  }
  h *= share;
  if (crease_mm > 0.0f) {
    const float t = p.y() / crease_spacing_m, u = p.x() / (1.3f * crease_spacing_m) + 0.5f;
    const float dy = (t - static_cast<float>(floor_int(t)) - 0.5f) * crease_spacing_m;
    const float dx = (u - static_cast<float>(floor_int(u)) - 0.5f) * 1.3f * crease_spacing_m;
    const auto ridge = [](float d) { return 1.0f - smooth_step(0.0f, 0.007f, std::abs(d)); };
    const float here = smooth_step(0.35f, 0.7f, noise(p.x() / 0.09f, p.y() / 0.09f, offset + 15));
    h += crease_mm * here * (ridge(dx) - ridge(dy));
  }
  if (family == "knit") {
    const float column = p.x() / scale_m;
    h += 100.0f * scale_m * std::abs(column - static_cast<float>(floor_int(column)) - 0.5f);
  }
  return h;
}

}  // namespace weft::synth
