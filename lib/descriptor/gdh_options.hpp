#pragma once

#include "base/options.hpp"

namespace weft::descriptor {

/// Geodesic-depth histogram; garment-parts.txt section 3.1 gives the definition, section 5.1 the
/// bins, and neither patch nor ranges nor normalisation.
struct GdhOptions {
  int patch_px = 41;
  double patch_mm = 55.0;
  int geodesic_bins = 8;
  double geodesic_max_mm = 28.0;
  int depth_bins = 11;
  double depth_range_mm = 15.0;
  int min_points = 40;

  void visit(OptionVisitor& v) {
    v.field("patch_px", patch_px, {3, 255}, "px",
            "side of the patch in the sensor view, as large as the patches of FINDDD");
    v.field("patch_mm", patch_mm, {1.0, 500.0}, "mm",
            "side of the patch in the rectified view: 41 px at the paper's 750 px/m");
    v.field("geodesic_bins", geodesic_bins, {1, 64}, "", "garment-parts.txt section 5.1: 8");
    v.field("geodesic_max_mm", geodesic_max_mm, {0.5, 1000.0}, "mm",
            "upper end of the last geodesic bin; the circle in the default patch");
    v.field("depth_bins", depth_bins, {1, 64}, "", "garment-parts.txt section 5.1: 11");
    v.field("depth_range_mm", depth_range_mm, {0.1, 1000.0}, "mm",
            "the depth bins reach from minus to plus this, relative to the centre; what lies "
            "beyond counts in the first or last: wrinkles are flatter than 30 degrees, mostly");
    v.field("min_points", min_points, {1, 65025}, "",
            "no word with fewer points within geodesic_max_mm: a tenth of those 0.7 m away");
  }
  void validate() const { validate_fields(*this, "GdhOptions"); }
};

}  // namespace weft::descriptor
