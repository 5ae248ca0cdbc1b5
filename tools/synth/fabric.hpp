#pragma once

#include <string>
#include <vector>

#include "base/random.hpp"
#include "synth/pattern_maps.hpp"

/// Colours of a garment. Drawn independently of its type, so that no detector can learn that jeans
/// are blue.
namespace weft::synth {

struct Print {  // one shape of a logo
  enum class Shape { kEllipse, kRing, kBox, kLetters } shape = Shape::kEllipse;
  int panel = 0;
  Vec2 centre = Vec2::Zero(), half_size = Vec2::Zero();
  Vec3 colour = Vec3::Zero();
};

struct Fabric {
  std::string family;     // plain, melange, stripes, ...
  bool held_out = false;  // family or hue reserved for testing
  std::uint32_t seed = 0;
  Vec3 base, second, third;  // linear RGB albedo
  Vec3 inside;               // of the inner face
  Vec3 trim;                 // of contrasting pieces
  Vec3 thread, button, label, label_text, cord, metal;
  std::uint32_t trimmed = 0;    // bit by Material: in the trim colour
  bool collar_trimmed = false;  // panels named collar or hood
  float weave = 0.0f;           // amplitude of the fine irregularity, share of the albedo
  float strength = 0.0f;        // of the family's pattern
  float scale_m = 0.01f;        // of the family's pattern
  float angle_sine = 0.0f, angle_cosine = 1.0f;  // of stripes and streaks
  float mottle = 0.0f;                           // amplitude of slow changes (wash)
  float wrinkle_mm = 0.0f, wrinkle_scale_m = 0.03f;
  float wrinkle_stretch = 2.5f;  // their length over their width
  float wrinkle_sine = 0.0f, wrinkle_cosine = 1.0f;
  float fold_mm = 0.0f, fold_scale_m = 0.03f;  // long sharp ridges between the wrinkles
  float fold_stretch = 6.0f;                   // their length over their width
  float fold_sine = 0.0f, fold_cosine = 1.0f;
  float stiff_share = 1.0f;  // of wrinkles and folds that collars, plackets and bands show
  bool plain_bands = false;  // collars and bands are knit on their own, without the pattern
  float band_tone = 1.0f;    // their albedo over the cloth's
  float crease_mm = 0.0f, crease_spacing_m = 0.2f;  // sharp lines left by folding
  float seam_relief = 1.0f;  // how strongly hems, grooves and seams are pronounced
  float sheen = 0.0f, gloss = 0.0f;
  float infrared_loss = 0.0f;  // share of depth pixels that near black cloth loses
  std::vector<Print> prints;

  /// Linear RGB albedo of a point of a panel.
  Vec3 albedo(Material material, const Panel& panel, int panel_index, const Vec2& pattern,
              bool is_inside) const;
  /// Height of fine wrinkles and of the knit, mm; share: of the wrinkles, see ease().
  float relief_mm(int panel_index, const Vec2& pattern, float share) const;
  /// How freely a material of a panel wrinkles: 1, or less where it is stiffened.
  float ease(Material material, const Panel& panel) const;
};

/// near: the table's albedo, which low-contrast fabrics come close to.
Fabric draw_fabric(Random& random, bool held_out, const Vec3& near, const Simulation& simulation);

/// Gives a drawn fabric what worn jersey shows close up: sharp folds that leave stiffened pieces
/// alone, bands knit on their own, melange in streaks of any strength.
void draw_wear(Random& random, Fabric& fabric);

}  // namespace weft::synth
