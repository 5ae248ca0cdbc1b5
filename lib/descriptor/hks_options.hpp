#pragma once

#include "base/error.hpp"
#include "base/options.hpp"

namespace weft::descriptor {

/// Scale-invariant heat kernel signature of the mesh around a point (Bronstein and Kokkinos 2010).
/// garment-parts.txt section 5.1 gives the patch, 60x60 px, and the frequencies kept, 60;
/// Laplacian, times and number of eigenpairs are not given.
struct HksOptions {
  enum class Method { kMoments, kEigenbasis };
  Method method = Method::kMoments;
  int patch_px = 60;
  double patch_mm = 80.0;
  int stride_px = 1;
  double t_min_mm2 = 0.5;
  int octaves = 12;
  int samples_per_octave = 16;
  int frequencies = 60;
  int eigenpairs = 200;
  double min_coverage = 0.1;

  int samples() const { return octaves * samples_per_octave + 1; }

  void visit(OptionVisitor& v) {
    v.choice("method", method, {{"moments", Method::kMoments}, {"eigenbasis", Method::kEigenbasis}},
             "moments: the whole spectrum at once, 1e-4 from the dense eigendecomposition; "
             "eigenbasis: the smallest eigenvalues alone, probably the paper's way: thousands of "
             "times slower, and wrong at small times");
    v.field("patch_px", patch_px, {3, 255}, "px",
            "side of the patch in the sensor view; garment-parts.txt section 5.1: 60");
    v.field("patch_mm", patch_mm, {1.0, 1000.0}, "mm",
            "side of the patch in the rectified view: 60 px at the paper's 750 px/m");
    v.field("stride_px", stride_px, {1, 8}, "px",
            "the mesh has one pixel in so many of a row and a column; must divide the grid's step; "
            "2 is about 7 times faster and another descriptor at times below the mesh's spacing");
    v.field("t_min_mm2", t_min_mm2, {0.01, 1000.0}, "mm^2",
            "first time; heat spreads over about 2 sqrt(t), so that 0.5 is one pixel");
    v.field("octaves", octaves, {1, 20}, "",
            "times reach t_min_mm2 * 2^octaves; 12: 2048 mm^2, over which heat fills the patch");
    v.field("samples_per_octave", samples_per_octave, {1, 64}, "",
            "of the logarithmic times; the usual tau = 1:1/16:25 of Bronstein and Kokkinos");
    v.field("frequencies", frequencies, {1, 512}, "",
            "magnitudes kept, from zero on; garment-parts.txt section 5.1: 60");
    v.field("eigenpairs", eigenpairs, {10, 1000}, "", "of the eigenbasis; the usual 100 to 300");
    v.field("min_coverage", min_coverage, {0.0, 1.0}, "",
            "no word where less of the patch hangs together with its centre");
  }
  void validate() const {
    validate_fields(*this, "HksOptions");
    if (frequencies > samples() / 2 + 1) {
      throw Error("HksOptions.frequencies is " + std::to_string(frequencies) + ", but " +
                  std::to_string(samples()) + " times have only " +
                  std::to_string(samples() / 2 + 1) + " different frequencies");
    }
  }
};

}  // namespace weft::descriptor
