#include "plane/moments.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>

#include "base/random.hpp"

namespace weft::plane {
namespace {

struct Pixel {
  double x, y, d;
};

Moments sum(const std::vector<Pixel>& pixels) {
  Moments m;
  for (const auto& [x, y, d] : pixels)
    m += Moments{1, x, y, x * x, x * y, y * y, d, x * d, y * d, d * d};
  return m;
}

std::vector<Pixel> noisy(const InversePlane& p, double noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<Pixel> pixels;
  for (int i = 0; i < 300; ++i) {
    const double x = random.uniform(-0.3, 0.1), y = random.uniform(0.2, 0.5);
    pixels.push_back({x, y, p.x() * x + p.y() * y + p.z() + noise * random.normal()});
  }
  return pixels;
}

TEST(Moments, FitEqualsLeastSquares) {
  const auto pixels = noisy({0.3, -0.2, 0.8}, 0.01, 3);
  Eigen::MatrixXd rows(pixels.size(), 3);
  Eigen::VectorXd right(pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    rows.row(static_cast<Eigen::Index>(i)) << pixels[i].x, pixels[i].y, 1.0;
    right[static_cast<Eigen::Index>(i)] = pixels[i].d;
  }
  const Eigen::Vector3d expected = rows.colPivHouseholderQr().solve(right);
  const auto fit = sum(pixels).fit();
  ASSERT_TRUE(fit);
  EXPECT_LT((*fit - expected).norm(), 1e-12);
  EXPECT_LT((sum(pixels).information() - rows.transpose() * rows).norm(), 1e-10);
  const InversePlane other(0.25, -0.1, 0.9);
  for (const InversePlane& p : {*fit, other})
    EXPECT_NEAR(sum(pixels).mean_square(p),
                (rows * p - right).squaredNorm() / static_cast<double>(pixels.size()), 1e-14);
}

TEST(Moments, MeasuresTheDistanceFromThePlane) {
  // A cell at one depth: points 4 mm before a steep plane.
  const InversePlane p(0.9, 0.1, 0.5);
  const rgbd::Plane plane = hesse(p);
  EXPECT_NEAR(plane.normal.norm(), 1.0, 1e-15);
  EXPECT_LT(plane.distance_m, 0.0);
  std::vector<Pixel> pixels;
  for (int i = 0; i < 100; ++i) {
    const double x = 0.2 + 0.001 * (i % 10), y = 0.1 + 0.001 * (i / 10);
    const Eigen::Vector3d on = Eigen::Vector3d(x, y, 1.0) / p.dot(Eigen::Vector3d(x, y, 1.0));
    EXPECT_NEAR(plane.height_m(on), 0.0, 1e-14);
    const double shift = 0.004 / plane.normal.dot(Eigen::Vector3d(x, y, 1.0));
    const Eigen::Vector3d before = on + shift * Eigen::Vector3d(x, y, 1.0);
    EXPECT_NEAR(plane.height_m(before), 0.004, 1e-12);
    pixels.push_back({x, y, 1.0 / before.z()});
  }
  EXPECT_NEAR(sum(pixels).mean_square_m(p), 0.004 * 0.004, 0.02 * 0.004 * 0.004);
  EXPECT_NEAR(plane.height_m(sum(pixels).centre(p)), 0.0, 1e-12);
}

TEST(Moments, NeedsMoreThanALine) {
  EXPECT_FALSE(Moments().fit());
  std::vector<Pixel> line;
  for (int i = 0; i < 50; ++i) line.push_back({0.1 + 0.01 * i, 0.2 - 0.007 * i, 1.0 + 0.01 * i});
  EXPECT_FALSE(sum(line).fit());
  line.push_back({0.1, 0.4, 1.0});
  EXPECT_TRUE(sum(line).fit());
}

}  // namespace
}  // namespace weft::plane
