#include "messages/view.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "stage/stage.hpp"

namespace weft::messages {
namespace {

rgbd::View rectified() {
  rgbd::View view;
  view.kind = rgbd::View::Kind::kRectified;
  view.width = 300;
  view.height = 200;
  view.sensor = {640, 480, 525.0, 524.0, 319.5, 239.5};
  view.sensor_from_view << 0.9, 0.01, 30, -0.02, 0.8, 40, 1e-5, -2e-5, 1.0;
  view.scale_px_per_m = 600.0;
  view.table.normal = Eigen::Vector3d(0.0, 0.6, -0.8);
  view.table.distance_m = -0.9;
  view.table.rms_m = 0.002;
  view.table.support = 1234;
  return view;
}

TEST(ViewMessage, CarriesEveryField) {
  const rgbd::View view = rectified();
  const rgbd::View back = from_message(to_message(view), "x");
  EXPECT_EQ(back.kind, view.kind);
  EXPECT_EQ(back.width, view.width);
  EXPECT_EQ(back.height, view.height);
  EXPECT_EQ(back.sensor, view.sensor);
  EXPECT_EQ(back.sensor_from_view, view.sensor_from_view);
  EXPECT_EQ(back.scale_px_per_m, view.scale_px_per_m);
  EXPECT_EQ(back.table.normal, view.table.normal);
  EXPECT_EQ(back.table.distance_m, view.table.distance_m);
  EXPECT_EQ(back.table.rms_m, view.table.rms_m);
  EXPECT_EQ(back.table.support, view.table.support);
}

TEST(ViewMessage, CarriesTheSensorView) {
  rgbd::View view;
  view.sensor = {320, 240, 262.0, 262.0, 159.5, 119.5};
  view.width = 320;
  view.height = 240;
  const rgbd::View back = from_message(to_message(view), "x");
  EXPECT_EQ(back.kind, rgbd::View::Kind::kSensor);
  EXPECT_EQ(back.width, 320);
  EXPECT_EQ(back.sensor, view.sensor);
}

TEST(ViewMessage, RefusesImpossibleContent) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](auto change) {
    view_t message = to_message(rectified());
    change(message);
    EXPECT_THROW(from_message(message, "x"), stage::InvalidInput);
  };
  refused([](view_t& m) { m.kind = 7; });
  refused([](view_t& m) { m.kind = view_t::SENSOR; });  // not of the sensor's size
  refused([](view_t& m) { m.width = 0; });
  refused([](view_t& m) { m.height = 1 << 30; });
  refused([](view_t& m) { m.sensor.width = -4; });
  refused([&](view_t& m) { m.sensor.fx = nan; });
  refused([&](view_t& m) { m.sensor_from_view[4] = nan; });
  refused([](view_t& m) { std::fill(m.sensor_from_view, m.sensor_from_view + 9, 1.0); });
  refused([](view_t& m) { m.scale_px_per_m = 0.0; });
  refused([](view_t& m) { m.table.normal[2] = -0.9; });
  refused([&](view_t& m) { m.table.distance_m = nan; });
  refused([](view_t& m) { m.table.rms_m = -1.0; });
  refused([](view_t& m) { m.table.support = -1; });
}

}  // namespace
}  // namespace weft::messages
