#pragma once

#include "base/options.hpp"
#include "plane/extractor.hpp"
#include "slam/features.hpp"
#include "slam/observations.hpp"

namespace weft::slam {

/// How well a feature's place is measured.
struct SensorNoise {
  double sigma_px = 1.2;
  double level_scale = 1.2;
  double inverse_depth_per_m = 0.005;
  double depth_floor_m = 0.003;

  void visit(OptionVisitor& v) {
    v.field("sigma_px", sigma_px, {0.05, 20.0}, "px",
            "standard deviation of a feature's pixel coordinates at the pyramid's first level; "
            "ORB-SLAM2: "
            "1; docs/mapping.md tells what others do to the recordings");
    v.field("level_scale", level_scale, {1.0, 2.0}, "",
            "by which it grows with each level: FeatureOptions::scale");
    v.field("inverse_depth_per_m", inverse_depth_per_m, {0.0, 0.1}, "1/m",
            "standard deviation of inverse depth, times z^2 that of depth: 0.0015 for a Kinect on "
            "a flat surface; corners lie on edges as well (ORB-SLAM2: 0.025)");
    v.field("depth_floor_m", depth_floor_m, {1e-5, 0.2}, "m", "added to it in quadrature");
  }
  void validate() const { validate_fields(*this, "SensorNoise"); }

  double pixel_px(int level) const;
  double depth_m(double z_m) const;
};

/// A feature as the optimisations take it in, with its depth where it has one. camera, point: 0.
PointObservation observe(const Feature& feature, const SensorNoise& noise);
/// Likewise a plane.
PlaneObservation observe(const plane::PlaneSegment& segment);

}  // namespace weft::slam
