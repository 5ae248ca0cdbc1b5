#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "plane/extractor.hpp"
#include "support/files.hpp"

namespace weft::plane {
namespace {

/// The cabinet of TUM fr3/cabinet stands on the floor, 0.55 m high, its faces at right angles.
TEST(RealScans, TheCabinetIsACuboid) {
  const auto folder = test::data_folder() / "tum-fr3-cabinet-58";
  WEFT_NEEDS_DATA(folder);
  for (const char* name : {"0000", "0020", "0040"}) {
    rgbd::RgbdFrame frame;
    frame.camera = {640, 480, 535.4, 539.2, 320.1, 247.6};
    frame.depth_unit_m = 0.0002;
    frame.depth = cv::imread((folder / "depth" / (std::string(name) + ".png")).string(),
                             cv::IMREAD_UNCHANGED);
    const auto found = Extractor({}).extract(frame);
    ASSERT_GE(found.planes.size(), 3u) << name;
    const auto sine = [&](int a, int b) {
      return found.planes[static_cast<std::size_t>(a)].plane.normal.dot(
          found.planes[static_cast<std::size_t>(b)].plane.normal);
    };
    // The floor, the front, the top.
    EXPECT_GT(found.planes[0].plane.support, 140000) << name;
    EXPECT_GT(sine(0, 2), std::cos(0.5 * M_PI / 180.0)) << name;
    EXPECT_LT(std::abs(sine(0, 1)), std::sin(2.0 * M_PI / 180.0)) << name;
    EXPECT_NEAR(found.planes[2].plane.distance_m - found.planes[0].plane.distance_m, 0.555, 0.015)
        << name;
  }
}

/// Garments on a table: the table is one plane, and it is nearly all that is flat.
TEST(RealScans, TheTableUnderAGarmentIsOnePlane) {
  const auto folder = test::data_folder() / "ctu-garments-3";
  WEFT_NEEDS_DATA(folder);
  for (const char* name : {"00023", "01158", "02321"}) {
    rgbd::RgbdFrame frame;
    frame.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
    frame.depth =
        cv::imread((folder / (std::string("cloD") + name + ".png")).string(), cv::IMREAD_UNCHANGED);
    const auto found = Extractor({}).extract(frame);
    ASSERT_GE(found.planes.size(), 1u) << name;
    EXPECT_GT(found.planes[0].plane.support, 230000) << name;
    EXPECT_LT(found.planes[0].plane.rms_m, 0.005) << name;
    for (std::size_t i = 1; i < found.planes.size(); ++i)
      EXPECT_LT(found.planes[i].plane.support, 25000) << name;
  }
}

}  // namespace
}  // namespace weft::plane
