#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "synth/simulation.hpp"

/// What lies where on the flat panels: materials, heights and parts, as images in pattern space.
/// They depend on the simulation only; colours come later (fabric.hpp).
namespace weft::synth {

enum class Material : std::uint8_t {
  kFabric,
  kThread,
  kHem,
  kRib,
  kPlacket,
  kPocket,
  kFly,
  kWaistband,
  kBeltLoop,
  kYoke,
  kLabel,
  kLabelText,
  kButton,
  kButtonHole,
  kRivet,
  kCord,
};

struct PanelMap {
  Vec2 origin = Vec2::Zero();  // pattern coordinates of the centre of texel (0, 0)
  float texel_m = 0.0005f;
  cv::Mat outside, inside;  // CV_8UC1, Material
  cv::Mat height_mm;        // CV_32FC1, towards the outside
  cv::Mat crevice;          // CV_8UC1, 255 = open; darker in the corners beside raised pieces
  cv::Mat parts;            // CV_32SC1, bit i = part instance i

  /// Nearest texel, moved to the border where it lies beyond.
  cv::Point texel(const Vec2& pattern) const;
  /// Bilinear.
  float height_at(const Vec2& pattern) const;
};

std::vector<PanelMap> make_panel_maps(const Simulation& simulation);

/// Box filter of width 2 radius + 1, `times` times over. CV_32FC1.
void box_blur(cv::Mat& image, int radius, int times);

}  // namespace weft::synth
