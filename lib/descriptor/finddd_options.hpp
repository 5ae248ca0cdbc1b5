#pragma once

#include "base/options.hpp"
#include "rgbd/normals.hpp"

namespace weft::descriptor {

/// FINDDD: histograms of normals; garment-parts.txt sections 3.1 and 5.1.
struct FindddOptions {
  int patch_px = 43;
  double patch_mm = 57.0;
  int cells = 4;
  int subdivisions = 1;
  bool soft_votes = true;
  bool l1 = false;
  double min_share = 0.5;
  rgbd::NormalOptions normals;

  void visit(OptionVisitor& v) {
    v.field("patch_px", patch_px, {3, 255}, "px",
            "side of the patch in the sensor view; garment-parts.txt section 5.1: 43");
    v.field("patch_mm", patch_mm, {1.0, 500.0}, "mm",
            "side of the patch in the rectified view: 43 px at the paper's 750 px/m");
    v.field("cells", cells, {1, 8}, "", "along each side of the patch; 4 gives the paper's 16");
    v.field("subdivisions", subdivisions, {0, 3}, "",
            "of the octahedron whose vertices are the bins: 5, 13, 41 or 145 bins; the paper takes "
            "13 for the noise of a Kinect");
    v.field("soft_votes", soft_votes,
            "a normal votes for every bin nearer than the least distance between bins; false: 1 "
            "for the nearest bin");
    v.field("l1", l1, "divide by the sum of all votes; false: raw sums, as in the paper");
    v.field("min_share", min_share, {0.0, 1.0}, "",
            "no word where fewer of the patch's pixels have a normal; those beyond the view have "
            "none");
    v.group("normals", normals);
  }
  void validate() const { validate_fields(*this, "FindddOptions"); }
};

}  // namespace weft::descriptor
