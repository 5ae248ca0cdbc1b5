#pragma once

#include <vector>

#include "base/options.hpp"
#include "detector/probability_map.hpp"

namespace weft::detector {

struct PeakOptions {
  int max_peaks = 3;
  double min_distance_px = 48.0;
  double min_probability = 0.02;

  void visit(OptionVisitor& v) {
    v.field("max_peaks", max_peaks, {1, 100}, "",
            "peaks of a part at most; each costs the second layer some 175 windows");
    v.field("min_distance_px", min_distance_px, {0.0, 1000.0}, "px",
            "a peak hides lower ones nearer than this, view px");
    v.field("min_probability", min_probability, {0.0, 1.0}, "", "lower peaks are dropped");
  }
  void validate() const { validate_fields(*this, "PeakOptions"); }
};

/// Local maxima of the map (8 neighbours; of equal ones the first in row-major order), best first,
/// none nearer to a better one than min_distance_px. step_px: view px between grid points.
std::vector<Candidate> find_peaks(const FixedMap& map, const std::string& part, double step_px,
                                  const PeakOptions& options);

}  // namespace weft::detector
