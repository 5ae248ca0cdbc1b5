#pragma once

#include "base/options.hpp"

namespace weft::descriptor {

/// Dense SIFT with VLFeat's geometry (vl_dsift): 4 x 4 spatial bins, 8 orientations.
struct SiftOptions {
  enum class Window { kFlat, kGaussian };
  int bin_px = 4;
  Window window = Window::kFlat;
  double window_size_bins = 2.0;
  bool presmooth = true;
  double contrast_threshold = 0.001;

  void visit(OptionVisitor& v) {
    v.field("bin_px", bin_px, {2, 16}, "px",
            "width of a spatial bin, a quarter of the patch; the paper gives none");
    v.choice("window", window, {{"flat", Window::kFlat}, {"gaussian", Window::kGaussian}},
             "weight of the samples: that of their bin (flat) or their own distance (gaussian)");
    v.field("window_size_bins", window_size_bins, {0.25, 16.0}, "bins",
            "standard deviation of the Gaussian weight; VLFeat's C API has 2, its phow 1.5");
    v.field("presmooth", presmooth,
            "smooth with sigma = sqrt((bin_px / 3)^2 - 1/4) px first, as Lowe's scale space would");
    v.field(
        "contrast_threshold", contrast_threshold, {0.0, 1.0}, "",
        "no word below this mean weighted gradient (VLFeat's norm; grey levels 0 to 1, per px)");
  }
  void validate() const { validate_fields(*this, "SiftOptions"); }
};

}  // namespace weft::descriptor
