#include "slam/sensor_noise.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"

namespace weft::slam {
namespace {

TEST(SensorNoise, GrowsWithLevelAndWithTheSquareOfDepth) {
  SensorNoise noise;
  noise.sigma_px = 0.8;
  noise.level_scale = 1.5;
  noise.inverse_depth_per_m = 0.004;
  noise.depth_floor_m = 0.0;
  EXPECT_NEAR(noise.pixel_px(0), 0.8, 1e-12);
  EXPECT_NEAR(noise.pixel_px(2), 0.8 * 2.25, 1e-12);
  EXPECT_NEAR(noise.depth_m(3.0), 0.036, 1e-12);
  // It is the noise of 1 / z: the same from 1 m as from 5 m.
  for (const double z : {1.0, 5.0}) {
    const double far = 1.0 / (1.0 / z - 1e-4 * noise.inverse_depth_per_m);
    EXPECT_NEAR(far - z, 1e-4 * noise.depth_m(z), 1e-9);
  }
  noise.depth_floor_m = 0.003;
  EXPECT_NEAR(noise.depth_m(1.0), 0.005, 1e-12);  // 3-4-5
}

TEST(SensorNoise, AFeatureWithoutDepthIsObservedWithoutOne) {
  Feature feature;
  feature.u_px = 12.5f;
  feature.v_px = 99.0f;
  feature.level = 1;
  const SensorNoise noise;
  EXPECT_FALSE(observe(feature, noise).sigma_depth_m > 0.0);
  feature.depth_m = 2.0f;
  const auto seen = observe(feature, noise);
  EXPECT_EQ(seen.pixel, Eigen::Vector2d(12.5, 99.0));
  EXPECT_EQ(seen.sigma_px, noise.pixel_px(1));
  EXPECT_EQ(seen.depth_m, 2.0);
  EXPECT_EQ(seen.sigma_depth_m, noise.depth_m(2.0));
}

TEST(SensorNoise, OptionsOutsideTheirRangeAreNamed) {
  SensorNoise noise;
  noise.sigma_px = 0.0;
  try {
    noise.validate();
    FAIL() << "nothing thrown";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("sigma_px"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace weft::slam
