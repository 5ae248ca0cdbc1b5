#pragma once

#include <cstdint>
#include <vector>

#include "base/options.hpp"
#include "detector/types.hpp"
#include "detector/window_scorer.hpp"

namespace weft::detector {

struct MapOptions {
  double smoothing_sigma_px = 5.0;
  double margin_px = 0.0;

  void visit(OptionVisitor& v) {
    v.field("smoothing_sigma_px", smoothing_sigma_px, {0.0, 200.0}, "px",
            "Gaussian smoothing of the map, view px; 5 is the authors' value. 0: none");
    v.field("margin_px", margin_px, {0.0, 1000.0}, "px",
            "the map is zero this near to the view's edge, where windows see half a garment; the "
            "rectified view has its own margin");
  }
  void validate() const { validate_fields(*this, "MapOptions"); }
};

/// Probability of a part at each grid point, in units of 2^-kProbabilityBits.
struct FixedMap {
  static constexpr int kProbabilityBits = 16;
  int columns = 0;
  int rows = 0;
  std::vector<std::int32_t> values;  // row-major
};

/// 1 / (1 + exp(-score)) in units of 2^-kProbabilityBits, from a table of det::logistic, linearly
/// interpolated: within 1 unit.
std::int32_t fixed_probability(double score);

/// Mean probability of the windows that cover each grid point, all shapes of the part together,
/// times the mask, smoothed, margin set to zero (garment-parts.txt section 3.2; Aldavert et al.
/// 2010). Grid points no window covers, and those outside the mask, are 0.
FixedMap probability_map(const WindowScorer& scorer, int part, const MapOptions& options);

/// 8 bit, the largest value becoming 255.
ProbabilityMap to_probability_map(const FixedMap& map, const std::string& part);

}  // namespace weft::detector
