#include "slam/sensor_noise.hpp"

#include <cmath>

namespace weft::slam {

double SensorNoise::pixel_px(int level) const {
  double sigma = sigma_px;
  for (int i = 0; i < level; ++i) sigma *= level_scale;
  return sigma;
}

double SensorNoise::depth_m(double z_m) const {
  return std::hypot(inverse_depth_per_m * z_m * z_m, depth_floor_m);
}

PointObservation observe(const Feature& feature, const SensorNoise& noise) {
  PointObservation seen;
  seen.pixel = {feature.u_px, feature.v_px};
  seen.sigma_px = noise.pixel_px(feature.level);
  if (feature.depth_m > 0.0f) {
    seen.depth_m = feature.depth_m;
    seen.sigma_depth_m = noise.depth_m(feature.depth_m);
  }
  return seen;
}

PlaneObservation observe(const plane::PlaneSegment& segment) {
  PlaneObservation seen;
  seen.normal_camera = segment.plane.normal;
  seen.distance_m = segment.plane.distance_m;
  seen.covariance = segment.covariance;
  return seen;
}

}  // namespace weft::slam
