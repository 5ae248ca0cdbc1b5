#include "base/det_math.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace weft::det {
namespace {

TEST(DetMath, ExpAgreesWithLibm) {
  for (double x = -700; x < 700; x += 0.137) ASSERT_NEAR(exp(x) / std::exp(x), 1.0, 2e-15) << x;
  EXPECT_EQ(exp(-1e9), 0.0);
  EXPECT_TRUE(std::isinf(exp(1e9)));
  EXPECT_TRUE(std::isnan(exp(NAN)));
}

TEST(DetMath, LogAgreesWithLibm) {
  for (double x = 1e-300; x < 1e300; x *= 1.37)
    ASSERT_NEAR(log(x), std::log(x), 1e-15 * std::fabs(std::log(x)) + 1e-15);
  EXPECT_EQ(log(1.0), 0.0);
}

TEST(DetMath, Atan2AgreesWithLibm) {
  for (int i = 0; i < 5000; ++i) {
    const double a = -3.1415 + i * 6.283 / 5000, r = 0.01 * (i % 7 + 1);
    const double y = r * std::sin(a), x = r * std::cos(a);
    ASSERT_NEAR(atan2(y, x), std::atan2(y, x), 1e-15) << a;
  }
  EXPECT_EQ(atan2(0.0, 0.0), 0.0);
  EXPECT_NEAR(atan2(0.0, -1.0), 3.14159265358979323846, 1e-15);
  EXPECT_NEAR(atan2(-1.0, 0.0), -1.57079632679489661923, 1e-15);
}

}  // namespace
}  // namespace weft::det
