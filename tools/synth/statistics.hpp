#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "dataset/scene.hpp"

/// Numbers that tell how scans look to the algorithms: the same measurement for synthetic and real
/// ones, so that the two can be compared.
namespace weft::synth {

struct ScanStatistics {
  double colour_mean = 0.0;      // grey levels
  double saturated_share = 0.0;  // of pixels with a channel of 254 or more
  double colour_noise = 0.0;     // grey levels, of the flattest fifth of blocks (Immerkaer 1996)
  std::array<double, 3> gradient = {};  // deciles 1, 5, 9 of dense SIFT norms, whole frame
  std::array<double, 3> gradient_of_parts =
      {};  // the same inside part polygons; 0 if there are none
  double depth_median_m = 0.0;
  double depth_noise_mm = 0.0;                   // rms about planes of 24 px, of the flattest fifth
  double depth_step_mm = 0.0;                    // between neighbouring values at the median depth
  std::array<double, 3> depth_correlation = {};  // of that noise, 1, 4 and 8 px apart
  double missing_share = 0.0;
  double missing_of_parts = 0.0;
};

/// Of the polygons of one part over a data set.
struct PartCount {
  int usable = 0;  // not ignored
  int ignored = 0;
  int centred = 0;  // usable, and the centre of the bounding box lies on the polygon: what a
                    // detector that finds the true box can score
};

/// Adds a scene's polygons.
void count_parts(const dataset::Scene& scene, std::map<std::string, PartCount>& parts);

/// Dense SIFT norm: mean gradient of 16 px windows (grey levels 0 to 1 a pixel), every 6 px.
ScanStatistics scan_statistics(const dataset::Scene& scene);

}  // namespace weft::synth
