#pragma once

#include "base/options.hpp"
#include "rgbd/normals.hpp"

namespace weft::descriptor {

/// Fast Point Feature Histograms on the surface a view shows.
struct FpfhOptions {
  double radius_m = 0.025;
  int min_neighbours = 10;
  rgbd::NormalOptions normals;

  void visit(OptionVisitor& v) {
    v.field(
        "radius_m", radius_m, {0.001, 0.1}, "m",
        "neighbours of a point, for its SPFH and its FPFH; the paper took PCL's defaults, which "
        "has none: a collar's width");
    v.field("min_neighbours", min_neighbours, {1, 65535}, "points",
            "no word with fewer: holes and far away, where a histogram of a few pairs is noise");
    v.group("normals", normals);
  }
  void validate() const {
    validate_fields(*this, "FpfhOptions");
    normals.validate();
  }
};

}  // namespace weft::descriptor
