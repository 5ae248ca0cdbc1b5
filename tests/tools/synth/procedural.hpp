#pragma once

#include <cmath>

#include "synth/simulation.hpp"

/// A simulation without a simulator: a flat sack, front and back panel sewn at the sides and the
/// bottom, open at the top, lying face up. Its "collar" is the top strip, its "cuff" a patch of the
/// front.
namespace weft::test {

inline synth::Simulation procedural_sack(const std::string& name = "sack", float ripple_m = 0.0f) {
  using synth::Vec2;
  using synth::Vec3;
  constexpr int kColumns = 24, kRows = 30;
  constexpr float kWidth = 0.36f, kHeight = 0.45f, kThickness = 0.004f;
  synth::Simulation s;
  s.name = name;
  s.seed = 1;
  s.generator = "procedural";
  s.garment = "tshirt";
  s.state = "flat";
  s.cut = "{}";
  s.wrinkledness_deg = 1.0;
  s.panels = {{"front", "front", 0}, {"back", "back", 0}};
  std::vector<int> index[2];
  for (int layer = 0; layer < 2; ++layer) {
    for (int j = 0; j <= kRows; ++j) {
      for (int i = 0; i <= kColumns; ++i) {
        const bool seam = i == 0 || i == kColumns || j == 0;
        if (layer == 1 && seam) {
          index[1].push_back(index[0][index[1].size()]);
          continue;
        }
        index[layer].push_back(static_cast<int>(s.pose.size()));
        const Vec2 p(kWidth * (static_cast<float>(i) / kColumns - 0.5f),
                     kHeight * static_cast<float>(j) / kRows);
        const float wave = ripple_m * std::sin(40.0f * p.x() + 25.0f * p.y());
        const float z = layer == 0 ? 0.002f + kThickness + ripple_m + wave : 0.002f;
        s.pattern.push_back(p);
        s.pose.emplace_back(p.x(), p.y() - 0.5f * kHeight, seam ? 0.002f + 0.5f * kThickness : z);
      }
    }
  }
  for (int layer = 0; layer < 2; ++layer) {
    const auto at = [&](int i, int j) {
      return index[layer][static_cast<std::size_t>(j * (kColumns + 1) + i)];
    };
    for (int j = 0; j < kRows; ++j) {
      for (int i = 0; i < kColumns; ++i) {
        const int a = at(i, j), b = at(i + 1, j), c = at(i + 1, j + 1), d = at(i, j + 1);
        // Diagonals that join no two seams, or front and back would share an edge there.
        const std::array<int, 3> one = i < kColumns / 2 ? std::array{a, b, c} : std::array{a, b, d};
        const std::array<int, 3> two = i < kColumns / 2 ? std::array{a, c, d} : std::array{b, c, d};
        for (const auto& f : {one, two}) {
          s.faces.push_back(layer == 0 ? f : std::array{f[0], f[2], f[1]});
        }
        s.panel_of_face.insert(s.panel_of_face.end(), 2, static_cast<std::uint8_t>(layer));
      }
    }
  }
  const std::vector<Vec2> top = {{-0.5f * kWidth, kHeight}, {0.5f * kWidth, kHeight}};
  const std::vector<Vec2> patch = {
      {-0.15f, 0.05f}, {-0.05f, 0.05f}, {-0.05f, 0.12f}, {-0.15f, 0.12f}};
  s.parts = {{"t-shirt collar", "collar", {{0, top, true, 0.05f}, {1, top, true, 0.05f}}},
             {"t-shirt sleeves", "left", {{0, patch, false, 0.0f}}}};
  const auto feature = [&](const char* kind, std::vector<Vec2> points) -> synth::Feature& {
    auto& f = s.features.emplace_back();
    f.kind = kind;
    f.points = std::move(points);
    return f;
  };
  feature("rib", top).width_m = 0.02f;
  feature("twin-stitch", {{-0.17f, 0.4f}, {0.17f, 0.4f}}).offset_m = 0.006f;
  feature("pocket", patch);
  feature("button", {{0.0f, 0.35f}}).radius_m = 0.006f;
  feature("label", {{-0.02f, 0.40f}, {0.02f, 0.40f}, {0.02f, 0.43f}, {-0.02f, 0.43f}}).inside =
      true;
  return s;
}

}  // namespace weft::test
