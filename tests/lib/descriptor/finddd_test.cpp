#include "descriptor/finddd.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "support/analytic_scene.hpp"
#include "support/files.hpp"
#include "support/plain_finddd.hpp"
#include "support/surfaces.hpp"

namespace weft::descriptor {
namespace {

/// Wrinkled cloth with a raised square, noise and holes.
rgbd::Surface cloth(int width, int height) {
  test::AnalyticScene scene;
  scene.camera = {width, height, 300.0, 300.0, 0.5 * width, 0.5 * height};
  scene.distance_m = 0.6;
  scene.holes = width * height / 1000;
  scene.missing_px = width * height / 100;
  scene.layers[0].height_m = [](double x, double y) { return 0.006 * std::sin(80 * x + 50 * y); };
  test::Layer raised;
  raised.height_m = [](double, double) { return 0.03; };
  raised.inside = [](double x, double y) { return std::abs(x) < 0.05 && std::abs(y) < 0.04; };
  scene.layers.push_back(raised);
  return test::render(scene).surface;
}

rgbd::Surface scan(const std::string& path, cv::Rect crop) {
  const rgbd::Surface whole = test::read_surface(path);
  return {whole.points_m(crop).clone(),
          {crop.width, crop.height, 525.0, 525.0, 319.5 - crop.x, 239.5 - crop.y}};
}

/// Compares each point with the definition; returns how many are described.
int expect_definition(const rgbd::Surface& surface, const FindddOptions& options, int patch_px,
                      int step_px) {
  const FindddDescriptor finddd(options);
  const cv::Size size = surface.points_m.size();
  const cv::Mat normals = rgbd::estimate_normals(surface, options.normals, 1);
  const Grid grid = make_grid(size.width, size.height, {step_px, 2});
  const cv::Mat mask = test::full_mask(surface);
  const auto sums = finddd.sums_of_surface(surface, mask, grid, patch_px, 2);
  const auto bytes = finddd.describe_surface(surface, mask, grid, patch_px, 2);
  EXPECT_EQ(sums.points, bytes.points);
  EXPECT_EQ(sums.dimension, finddd.dimension());
  const auto dimension = static_cast<std::size_t>(finddd.dimension());
  std::size_t at = 0;
  for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
    const int x = grid.x(static_cast<int>(cell) % grid.columns);
    const int y = grid.y(static_cast<int>(cell) / grid.columns);
    const auto expected = test::plain_finddd(normals, x, y, patch_px, options);
    EXPECT_EQ(sums.state[cell], expected.described ? PointState::kDescribed : PointState::kNothing);
    EXPECT_EQ(bytes.state[cell], sums.state[cell]);
    if (!expected.described) continue;
    double total = 0.0;
    for (const double v : expected.sums) total += v;
    for (std::size_t k = 0; k < dimension; ++k) {
      // Each vote is rounded to 1/4096.
      const double rounding = expected.largest_cell_px * 0.5001 / 4096;
      const double value = options.l1 ? expected.sums[k] / total : expected.sums[k];
      const double to_byte =
          options.l1 ? 255.0 * options.cells * options.cells : 255.0 / expected.largest_cell_px;
      // The sum of all is off by at most as much in each of its values.
      const double tolerance =
          options.l1 ? rounding * (1.0 + double(dimension) * value) / total : rounding;
      EXPECT_NEAR(sums.values[at * dimension + k], value, tolerance + 1e-4 * value);
      EXPECT_NEAR(bytes.values[at * dimension + k], std::min(255.0, to_byte * value),
                  0.501 + to_byte * tolerance);
    }
    ++at;
  }
  EXPECT_EQ(at, sums.points.size());
  return static_cast<int>(at);
}

TEST(Finddd, BinsAreTheVerticesOfASubdividedOctahedron) {
  const double pi = std::acos(-1.0);
  const std::size_t counts[] = {5, 13, 41, 145};
  const double chords[] = {std::sqrt(2.0), 0.765, 0.390, 0.196};
  for (int subdivisions = 0; subdivisions < 4; ++subdivisions) {
    const auto bins = finddd_bins(subdivisions);
    ASSERT_EQ(bins.size(), counts[subdivisions]);
    EXPECT_EQ(bins[0], (std::array<double, 3>{0, 0, -1}));
    double chord = 2.0;
    for (const auto& a : bins) {
      EXPECT_NEAR(std::hypot(a[0], a[1], a[2]), 1.0, 1e-15);
      EXPECT_LE(a[2], 0.0);
      for (const auto& b : bins) {
        if (&a != &b) chord = std::min(chord, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
      }
    }
    EXPECT_NEAR(chord, chords[subdivisions], 1e-3);
  }
  // The 13 of the paper: four at 45 degrees, then eight on the equator, both from +x on.
  const auto bins = finddd_bins(1);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(bins[1 + i][2], -std::sqrt(0.5), 1e-15);
    EXPECT_NEAR(std::atan2(bins[1 + i][1], bins[1 + i][0]), std::remainder(i * pi / 2, 2 * pi),
                1e-12);
  }
  for (std::size_t i = 0; i < 8; ++i) {
    EXPECT_NEAR(bins[5 + i][0], std::cos(static_cast<double>(i) * pi / 4), 1e-12);
    EXPECT_NEAR(bins[5 + i][1], std::sin(static_cast<double>(i) * pi / 4), 1e-12);
  }
}

TEST(Finddd, IsTheDefinition) {
  const auto surface = cloth(110, 90);
  FindddOptions options;
  EXPECT_GT(expect_definition(surface, options, 43, 11), 40);
  EXPECT_GT(expect_definition(surface, options, 34, 11), 40);
  options.min_share = 0.0;
  EXPECT_GT(expect_definition(surface, options, 7, 13), 40);
  EXPECT_GT(expect_definition(surface, options, 120, 30), 5);  // larger than the image
  options.l1 = true;
  EXPECT_GT(expect_definition(surface, options, 43, 17), 20);
  for (const int subdivisions : {0, 2, 3}) {
    options.subdivisions = subdivisions;
    options.l1 = subdivisions == 2;
    options.cells = 1 + subdivisions;
    EXPECT_GT(expect_definition(surface, options, 30, 17), 20);
    options.soft_votes = false;
    EXPECT_GT(expect_definition(surface, options, 30, 17), 20);
    options.soft_votes = true;
  }
}

TEST(Finddd, IsTheDefinitionOnScans) {
  for (const char* file :
       {"pcl-scans/office1.pcd", "uc3m-garments/pcd/20150902_towel02_2_fold.pcd"}) {
    const auto path = test::data_folder() / file;
    WEFT_NEEDS_DATA(path);
    EXPECT_GT(expect_definition(scan(path, {230, 150, 180, 130}), {}, 43, 13), 40);
  }
}

TEST(Finddd, OfATableFillsTheZenith) {
  rgbd::Surface surface;
  surface.camera = {80, 80, 500.0, 500.0, 40.0, 40.0};
  surface.points_m = test::surface_of(80, 80, [&](int x, int y) {
                       const auto p = surface.camera.unproject(x, y, 0.7);
                       return cv::Vec3d(p.x(), p.y(), p.z());
                     }).points_m;
  const FindddDescriptor finddd{FindddOptions{}};
  const Grid grid{40, 40, 1, 1, 1};
  const auto sums = finddd.sums_of_surface(surface, test::full_mask(surface), grid, 40, 1);
  const auto bytes = finddd.describe_surface(surface, test::full_mask(surface), grid, 40, 1);
  ASSERT_EQ(sums.values.size(), 208u);
  for (std::size_t k = 0; k < 208; ++k) {
    EXPECT_NEAR(sums.values[k], k % 13 == 0 ? 100.0 : 0.0, 0.05);
    EXPECT_EQ(bytes.values[k], k % 13 == 0 ? 255 : 0);
  }
}

TEST(Finddd, HasTheSameBitsOnEveryPathAndThreadCount) {
  const auto surface = cloth(157, 99);
  const cv::Mat mask = test::full_mask(surface);
  const Grid grid = make_grid(157, 99, {});
  for (const int subdivisions : {0, 1, 2}) {
    for (const bool soft : {true, false}) {
      FindddOptions options;
      options.subdivisions = subdivisions;
      options.soft_votes = soft;
      options.l1 = subdivisions == 0;
      const FindddDescriptor baseline(options, SimdPath::kBaseline);
      const auto bytes = baseline.describe_surface(surface, mask, grid, 43, 1);
      const auto sums = baseline.sums_of_surface(surface, mask, grid, 43, 1);
      EXPECT_GT(bytes.points.size(), 100u);
      for (const auto path : {SimdPath::kBaseline, SimdPath::kAvx2}) {
        if (!simd_path_available(path)) GTEST_SKIP() << "AVX2: this processor has none";
        const FindddDescriptor other(options, path);
        for (const int threads : {1, 2, 3}) {
          const auto again = other.describe_surface(surface, mask, grid, 43, threads);
          EXPECT_EQ(bytes.state, again.state);
          EXPECT_EQ(bytes.points, again.points);
          EXPECT_EQ(bytes.values, again.values);
          EXPECT_EQ(sums.values, other.sums_of_surface(surface, mask, grid, 43, threads).values);
        }
      }
    }
  }
}

TEST(Finddd, DescribesOnlyInsideTheMaskAndTheSameAsWithoutOne) {
  const auto surface = cloth(160, 120);
  const Grid grid = make_grid(160, 120, {});
  const FindddDescriptor finddd{FindddOptions{}};
  const auto all = finddd.describe_surface(surface, test::full_mask(surface), grid, 21, 1);
  cv::Mat mask = cv::Mat::zeros(120, 160, CV_8UC1);
  mask(cv::Rect(70, 8, 30, 20)) = 255;
  mask(cv::Rect(20, 90, 60, 30)) = 1;  // far enough below to begin anew
  const auto some = finddd.describe_surface(surface, mask, grid, 21, 2);
  std::size_t at = 0, at_all = 0;
  for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
    const int x = grid.x(static_cast<int>(cell) % grid.columns);
    const int y = grid.y(static_cast<int>(cell) / grid.columns);
    const bool inside = mask.at<std::uint8_t>(y, x) != 0;
    EXPECT_EQ(some.state[cell], inside ? all.state[cell] : PointState::kOutsideMask);
    if (all.state[cell] != PointState::kDescribed) continue;
    if (inside) {
      EXPECT_TRUE(std::equal(some.values.begin() + static_cast<std::ptrdiff_t>(at * 208),
                             some.values.begin() + static_cast<std::ptrdiff_t>(at * 208 + 208),
                             all.values.begin() + static_cast<std::ptrdiff_t>(at_all * 208)));
      ++at;
    }
    ++at_all;
  }
  EXPECT_GT(at, 50u);
  EXPECT_EQ(at, some.points.size());
}

TEST(Finddd, TakesItsPatchInMillimetresFromTheRectifiedView) {
  rgbd::RgbdFrame frame;
  frame.camera = {160, 120, 150.0, 150.0, 79.5, 59.5};
  frame.colour = cv::Mat::zeros(120, 160, CV_8UC3);
  frame.depth.create(120, 160, CV_16UC1);
  for (int v = 0; v < 120; ++v)
    for (int u = 0; u < 160; ++u)
      frame.depth.at<std::uint16_t>(v, u) =
          static_cast<std::uint16_t>(600 + 8 * std::sin(0.2 * u + 0.1 * v));
  const cv::Mat mask(120, 160, CV_8UC1, cv::Scalar(255));
  rgbd::Plane table;
  table.distance_m = -0.61;
  FindddOptions options;
  options.patch_mm = 50.0;
  options.patch_px = 21;
  const FindddDescriptor finddd(options);
  for (const double scale : {0.0, 260.0, 500.0}) {
    rgbd::ViewOptions view_options;
    view_options.rectified = scale > 0.0;
    if (scale > 0.0) view_options.scale_px_per_m = scale;
    const auto view = rgbd::make_view(frame, mask, &table, view_options);
    const auto images = rgbd::render_view(frame, mask, view);
    const Grid grid = make_grid(view.width, view.height, {});
    const auto field = finddd.describe(frame, view, images, grid, 1);
    const auto expected =
        finddd.describe_surface(rgbd::render_surface(frame, view), images.mask, grid,
                                scale > 0.0 ? static_cast<int>(0.05 * scale) : 21, 1);
    EXPECT_GT(field.points.size(), 100u);
    EXPECT_EQ(field.state, expected.state);
    EXPECT_EQ(field.values, expected.values);
  }
}

TEST(Finddd, HasNoWordWhereThereIsNothing) {
  const float inf = std::numeric_limits<float>::infinity();
  for (const int side : {1, 2, 60}) {
    for (const float depth : {test::kNoPoint[0], inf, -inf, 0.0f, -1.0f}) {
      rgbd::Surface surface;
      surface.camera = {side, side, 500.0, 500.0, 0.5 * side, 0.5 * side};
      surface.points_m = cv::Mat(side, side, CV_32FC3, cv::Scalar::all(depth));
      FindddOptions options;
      for (const double share : {0.0, 0.5}) {
        options.min_share = share;
        const auto field = FindddDescriptor(options).describe_surface(
            surface, test::full_mask(surface), {0, 0, 1, side, side}, 43, 2);
        EXPECT_TRUE(field.points.empty());
        for (const auto state : field.state) EXPECT_EQ(state, PointState::kNothing);
      }
    }
  }
  // Full of holes: a pixel in three is there.
  auto surface = cloth(100, 80);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 100; ++x)
      if ((x + 7 * y) % 3 != 0) surface.points_m.at<cv::Vec3f>(y, x) = test::kNoPoint;
  const auto field =
      FindddDescriptor(FindddOptions{})
          .describe_surface(surface, test::full_mask(surface), make_grid(100, 80, {}), 43, 1);
  EXPECT_TRUE(field.points.empty());
  FindddOptions sparse;
  sparse.min_share = 0.2;
  EXPECT_GT(expect_definition(surface, sparse, 43, 11), 10);
}

TEST(Finddd, RefusesWhatDoesNotFit) {
  const auto surface = cloth(60, 50);
  const FindddDescriptor finddd{FindddOptions{}};
  const Grid grid = make_grid(60, 50, {});
  const cv::Mat mask = test::full_mask(surface);
  EXPECT_THROW(finddd.describe_surface(surface, mask.rowRange(0, 20), grid, 43, 1), Error);
  EXPECT_THROW(finddd.describe_surface(surface, mask, make_grid(80, 50, {}), 43, 1), Error);
  EXPECT_THROW(finddd.describe_surface(surface, mask, grid, 3, 1), Error);
  EXPECT_THROW(finddd.describe_surface(surface, mask, grid, 513, 1), Error);
  FindddOptions options;
  options.subdivisions = 4;
  EXPECT_THROW(FindddDescriptor{options}, Error);
  options = {};
  options.normals.radius_m = 0.0;
  EXPECT_THROW(FindddDescriptor{options}, Error);
}

}  // namespace
}  // namespace weft::descriptor
