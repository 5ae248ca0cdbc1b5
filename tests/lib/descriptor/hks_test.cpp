#include "descriptor/hks.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "descriptor/heat_series.hpp"
#include "support/dense_heat.hpp"
#include "support/files.hpp"
#include "support/surfaces.hpp"

namespace weft::descriptor {
namespace {

using test::kNoPoint;

cv::Rect patch_around(cv::Point centre, int size, cv::Size image) {
  return cv::Rect(centre.x - size / 2, centre.y - size / 2, size, size) & cv::Rect({}, image);
}

// Greatest error of the descriptors of a grid against the dense eigendecomposition, as a share of
// each descriptor's largest value. `points` becomes the number of those compared.
double error_against_dense(const rgbd::Surface& surface, const Grid& grid, int patch_px,
                           const HksOptions& options, int& points) {
  const auto field =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, patch_px, 2);
  const auto size = static_cast<std::size_t>(options.frequencies);
  points = static_cast<int>(field.points.size());
  double worst = 0.0;
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    const cv::Point centre(grid.x(field.points[i] % grid.columns),
                           grid.y(field.points[i] / grid.columns));
    const auto dense = test::dense_hks(
        surface, patch_around(centre, patch_px, surface.points_m.size()), centre, options);
    if (dense.empty()) {
      ADD_FAILURE() << "described a point in no triangle: " << centre;
      continue;
    }
    const double largest = *std::max_element(dense.begin(), dense.end());
    for (std::size_t k = 0; k < size; ++k)
      worst = std::max(worst, std::abs(field.values[i * size + k] - dense[k]) / largest);
  }
  return worst;
}

TEST(HeatSeries, IsTheExponential) {
  const int per_octave = 16, samples = 193, step = HeatSeries::step_for(5.065, per_octave);
  const double lambda = HeatSeries::bound(step, per_octave);
  EXPECT_GE(lambda, 5.065);
  EXPECT_LT(lambda, 5.065 * std::exp2(1.001 / 16));
  const HeatSeries series(0.5, samples, per_octave, step - 40, step);
  for (const int sample : {0, 1, 50, 100, 192}) {
    const double t = 0.5 * std::exp2(sample / 16.0);
    const auto row = series.row(step, sample);
    EXPECT_NEAR(row.z, 0.5 * t * lambda, 1e-10 * t * lambda);
    EXPECT_LE(row.count, series.most(step));
    EXPECT_EQ(row.count % 8, 0);
    for (const double x : {0.0, 0.001, 0.1, 0.5, 0.99, 1.0}) {
      double sum = row.values[1];
      for (int j = 1; j < row.count; ++j) {
        sum += (j % 2 ? -2 : 2) * row.values[j + 1] * std::cos(j * std::acos(2 * x - 1));
      }
      EXPECT_NEAR(sum, std::exp(-t * lambda * x), 1.1e-7) << sample << " " << x;
    }
  }
  for (const double eigenvalue : {1e-6, 0.3, 1.0, 224.0}) {
    const int at = HeatSeries::step_for(eigenvalue, 4);
    EXPECT_GE(HeatSeries::bound(at, 4) * (1 + 1e-15), eigenvalue);
    EXPECT_LT(HeatSeries::bound(at - 1, 4), eigenvalue * (1 + 1e-15));
  }
}

TEST(Hks, AgreesWithTheDenseEigendecomposition) {
  for (const bool holes : {false, true}) {
    const auto surface = test::wrinkled(60, 50, 4, holes);
    HksOptions options;
    int points;
    // Patches that overhang the image, of even and of odd size.
    EXPECT_LT(error_against_dense(surface, make_grid(60, 50, {22, 6}), 15, options, points), 1e-4);
    EXPECT_GE(points, 6);
    EXPECT_LT(error_against_dense(surface, {30, 26, 6, 1, 1}, 26, options, points), 1e-4);
    EXPECT_EQ(points, 1);
    options.t_min_mm2 = 2.0;
    options.octaves = 9;
    options.samples_per_octave = 7;
    options.frequencies = 32;
    EXPECT_LT(error_against_dense(surface, {30, 26, 6, 1, 1}, 20, options, points), 1e-4);
  }
}

TEST(Hks, AgreesWithTheDenseEigendecompositionOnRealScans) {
  for (const char* name :
       {"pcl-scans/office1.pcd", "uc3m-garments/pcd/20150902_towel02_2_fold.pcd"}) {
    const auto path = (test::data_folder() / name).string();
    WEFT_NEEDS_DATA(path);
    rgbd::Surface surface = test::read_surface(path);
    surface.points_m = surface.points_m(cv::Rect(260, 180, 120, 100));
    int points;
    const double error =
        error_against_dense(surface, make_grid(120, 100, {60, 25}), 22, {}, points);
    EXPECT_GE(points, 2) << name;
    EXPECT_LT(error, 1e-3) << name;
  }
}

TEST(Hks, OnAPlaneHeatHalvesEachOctave) {
  // Far from the patch's border and from the mesh's spacing k_t = 1 / (4 pi t).
  HksOptions options;
  options.t_min_mm2 = 16.0;
  options.octaves = 3;
  options.frequencies = 2;
  const auto plane = test::surface_of(
      101, 101, [](int x, int y) { return cv::Vec3d(0.0011 * x, 0.0012 * y, 1.0 + 0.0003 * x); });
  const auto field = HksDescriptor(options).describe_surface(plane, test::full_mask(plane),
                                                             {50, 50, 6, 1, 1}, 101, 1);
  ASSERT_EQ(field.values.size(), 2u);
  EXPECT_NEAR(field.values[0], std::log(2.0) * options.samples(), 0.02 * options.samples());
}

TEST(Hks, KnowsNoScale) {
  // The same wrinkles half as large are the same signal an octave of length, two of time, earlier.
  const auto surface_at = [](double scale) {
    return test::surface_of(61, 61, [&](int x, int y) {
      return cv::Vec3d(scale * 0.001 * (x - 30), scale * 0.001 * (y - 30),
                       1.0 + scale * 0.004 * std::sin(0.3 * x) * std::cos(0.2 * y));
    });
  };
  HksOptions options;
  const auto large = surface_at(1.0), small = surface_at(0.5);
  const Grid grid{30, 30, 6, 1, 1};
  const auto at_large =
      HksDescriptor(options).describe_surface(large, test::full_mask(large), grid, 61, 1);
  options.t_min_mm2 /= 4.0;
  const auto at_small =
      HksDescriptor(options).describe_surface(small, test::full_mask(small), grid, 61, 1);
  ASSERT_EQ(at_large.values.size(), 60u);
  for (std::size_t k = 0; k < 60; ++k)
    EXPECT_NEAR(at_small.values[k], at_large.values[k], 1e-4 * at_large.values[0]);
}

TEST(Hks, IsTheSameOnEachPathAndForEachNumberOfThreads) {
  const auto surface = test::wrinkled(130, 90, 3, true);
  const Grid grid = make_grid(130, 90, {18, 3});
  for (const int patch_px : {23, 32}) {
    const auto expected =
        HksDescriptor({}, SimdPath::kBaseline)
            .describe_surface(surface, test::full_mask(surface), grid, patch_px, 1);
    ASSERT_GT(expected.points.size(), 25u);
    for (const auto path : {SimdPath::kBaseline, SimdPath::kAvx2}) {
      if (!simd_path_available(path)) continue;
      for (const int threads : {1, 2, 3}) {
        const auto field = HksDescriptor({}, path).describe_surface(
            surface, test::full_mask(surface), grid, patch_px, threads);
        EXPECT_EQ(field.points, expected.points);
        EXPECT_EQ(field.values, expected.values);
      }
    }
  }
}

TEST(Hks, DependsOnItsPatchAlone) {
  const auto surface = test::wrinkled(100, 80, 8, true);
  rgbd::Surface crop;
  crop.points_m = surface.points_m(cv::Rect(30, 20, 31, 31));
  const Grid grid = make_grid(100, 80, {5, 5});
  const auto whole =
      HksDescriptor({}).describe_surface(surface, test::full_mask(surface), grid, 30, 2);
  const auto alone =
      HksDescriptor({}).describe_surface(crop, test::full_mask(crop), {15, 15, 5, 1, 1}, 30, 1);
  ASSERT_EQ(alone.points.size(), 1u);
  const auto cell = std::find(whole.points.begin(), whole.points.end(), 6 * grid.columns + 8) -
                    whole.points.begin();
  ASSERT_LT(cell, static_cast<std::ptrdiff_t>(whole.points.size()));
  const std::vector<float> values(whole.values.begin() + cell * 60,
                                  whole.values.begin() + (cell + 1) * 60);
  EXPECT_EQ(values, alone.values);
}

TEST(Hks, OfEverySecondPixelIsThatOfASmallerScan) {
  const auto surface = test::wrinkled(80, 60, 6, true);
  const auto decimated = test::surface_of(40, 30, [&](int x, int y) {
    return cv::Vec3d(surface.points_m.at<cv::Vec3f>(2 * y, 2 * x));
  });
  HksOptions options;
  const auto expected = HksDescriptor(options).describe_surface(
      decimated, test::full_mask(decimated), {3, 3, 6, 6, 5}, 15, 1);
  options.stride_px = 2;
  const auto field = HksDescriptor(options).describe_surface(surface, test::full_mask(surface),
                                                             {6, 6, 12, 6, 5}, 30, 1);
  EXPECT_GT(field.points.size(), 15u);
  EXPECT_EQ(field.points, expected.points);
  // The two differ in which depth jumps they cross: twice the pixels, twice the step.
  std::size_t same = 0;
  for (std::size_t i = 0; i < field.points.size(); ++i) {
    same += std::equal(field.values.begin() + static_cast<std::ptrdiff_t>(60 * i),
                       field.values.begin() + static_cast<std::ptrdiff_t>(60 * (i + 1)),
                       expected.values.begin() + static_cast<std::ptrdiff_t>(60 * i));
  }
  EXPECT_GT(same, field.points.size() / 2);
  options.stride_px = 5;
  EXPECT_THROW(HksDescriptor(options).describe_surface(surface, test::full_mask(surface),
                                                       {6, 6, 12, 6, 5}, 30, 1),
               Error);
}

TEST(Hks, EigenbasisOfAllPairsIsTheWholeSpectrum) {
  const auto surface = test::wrinkled(40, 40, 2, true);
  const Grid grid{8, 8, 12, 3, 3};
  HksOptions options;
  const auto moments =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, 15, 1);
  options.method = HksOptions::Method::kEigenbasis;
  options.eigenpairs = 225;
  const auto all =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, 15, 2);
  ASSERT_GT(moments.points.size(), 5u);
  ASSERT_EQ(all.points, moments.points);
  for (std::size_t i = 0; i < all.values.size(); ++i)
    EXPECT_NEAR(all.values[i], moments.values[i], 1e-4 * all.values[i / 60 * 60]);
}

TEST(Hks, TruncatedEigenbasisAgreesAtLargeTimes) {
  const auto surface = test::wrinkled(40, 40, 2, true);
  const Grid grid{20, 20, 12, 1, 1};
  HksOptions options;
  options.t_min_mm2 = 64.0;
  options.octaves = 5;
  options.frequencies = 40;
  const auto moments =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, 30, 1);
  options.method = HksOptions::Method::kEigenbasis;
  options.eigenpairs = 100;  // of 900: by Spectra
  const auto some =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, 30, 1);
  ASSERT_EQ(some.values.size(), 40u);
  for (std::size_t k = 0; k < 40; ++k)
    EXPECT_NEAR(some.values[k], moments.values[k], 1e-3 * moments.values[0]);
  options.t_min_mm2 = 0.5;  // where all the other eigenvalues count
  const auto early =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, 30, 1);
  options.method = HksOptions::Method::kMoments;
  const auto right =
      HksDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, 30, 1);
  EXPECT_GT(std::abs(early.values[0] - right.values[0]), 0.3f * right.values[0]);
}

TEST(Hks, SeesNothingWhereThereIsNone) {
  for (const auto method : {HksOptions::Method::kMoments, HksOptions::Method::kEigenbasis}) {
    HksOptions options;
    options.method = method;
    options.min_coverage = 0.0;
    const HksDescriptor hks(options);
    struct Scene {
      float z;
      int width, height;
    };
    // One point, one row, one column, all missing, all infinite, twice the same points.
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    for (const auto& [z, width, height] : {Scene{1.0f, 1, 1},
                                           {1.0f, 30, 1},
                                           {1.0f, 1, 30},
                                           {kNan, 30, 30},
                                           {kInfinity, 30, 30},
                                           {0.0f, 30, 30}}) {
      const auto surface = test::surface_of(width, height, [&](int x, int y) {
        return z == 0.0f ? cv::Vec3d(0, 0, 1) : cv::Vec3d(x * 1e-3, y * 1e-3, z);
      });
      const auto field = hks.describe_surface(surface, test::full_mask(surface),
                                              make_grid(width, height, {6, 0}), 20, 1);
      EXPECT_TRUE(field.points.empty());
      for (const auto state : field.state) EXPECT_EQ(state, PointState::kNothing);
    }
    // A missing centre, a centre by itself, an island, a point outside the mask.
    options.min_coverage = 0.1;
    auto surface =
        test::surface_of(90, 30, [](int x, int y) { return cv::Vec3d(0.001 * x, 0.001 * y, 1.0); });
    const auto none = cv::Scalar(kNoPoint[0], kNoPoint[0], kNoPoint[0]);
    surface.points_m.at<cv::Vec3f>(15, 15) = kNoPoint;
    surface.points_m(cv::Rect(29, 14, 3, 3)) = none;
    surface.points_m.at<cv::Vec3f>(15, 30) = {0.030f, 0.015f, 1.0f};
    surface.points_m(cv::Rect(42, 12, 7, 7)) = none;
    for (int y = 13; y < 18; ++y) {
      for (int x = 43; x < 48; ++x)
        surface.points_m.at<cv::Vec3f>(y, x) = {0.001f * float(x), 0.001f * float(y), 1.0f};
    }
    cv::Mat mask = test::full_mask(surface);
    mask.at<std::uint8_t>(15, 75) = 0;
    const auto field =
        HksDescriptor(options).describe_surface(surface, mask, {15, 15, 15, 5, 1}, 20, 1);
    const std::vector<PointState> expected = {PointState::kNothing, PointState::kNothing,
                                              PointState::kNothing, PointState::kDescribed,
                                              PointState::kOutsideMask};
    EXPECT_EQ(field.state, expected);
    ASSERT_EQ(field.values.size(), 60u);
    for (const float v : field.values) EXPECT_TRUE(std::isfinite(v));
  }
}

TEST(Hks, BearsPointsOfAnySize) {
  // A nanometre apart, and a kilometre.
  for (const double spacing_m : {1e-9, 1e-4, 1.0, 1000.0}) {
    const auto surface = test::surface_of(
        30, 30, [&](int x, int y) { return cv::Vec3d(spacing_m * x, spacing_m * y, 1.0); });
    const auto field = HksDescriptor({}).describe_surface(surface, test::full_mask(surface),
                                                          {15, 15, 6, 1, 1}, 12, 1);
    EXPECT_EQ(field.points.size(), spacing_m < 2e-4 ? 0u : 1u) << spacing_m;
    for (const float v : field.values) EXPECT_TRUE(std::isfinite(v));
  }
}

TEST(Hks, RoundsToBytes) {
  rgbd::RgbdFrame frame;
  frame.camera = {80, 80, 525, 525, 40, 40};
  frame.colour.create(80, 80, CV_8UC3);
  frame.depth.create(80, 80, CV_16UC1);
  const auto surface = test::wrinkled(80, 80, 9, false);
  for (int y = 0; y < 80; ++y) {
    for (int x = 0; x < 80; ++x) {
      frame.depth.at<std::uint16_t>(y, x) =
          static_cast<std::uint16_t>(std::lround(1000 * surface.points_m.at<cv::Vec3f>(y, x)[2]));
    }
  }
  const cv::Mat mask(80, 80, CV_8UC1, cv::Scalar(255));
  rgbd::ViewOptions sensor;
  sensor.rectified = false;
  const auto view = rgbd::make_view(frame, mask, nullptr, sensor);
  const Grid grid = make_grid(80, 80, {18, 6});
  DescriptorOptions options;
  options.kind = DescriptorOptions::Kind::kHks;
  options.hks.patch_px = 30;
  const auto hks = make_descriptor(options);
  EXPECT_EQ(hks->name(), "hks");
  EXPECT_EQ(hks->dimension(), 60);
  const auto bytes = hks->describe(frame, view, {frame.colour, mask}, grid, 1);
  const auto floats = HksDescriptor(options.hks)
                          .describe_surface(rgbd::render_surface(frame, view), mask, grid, 30, 1);
  ASSERT_EQ(bytes.points, floats.points);
  ASSERT_GT(bytes.points.size(), 10u);
  ASSERT_EQ(bytes.values.size(), floats.values.size());
  for (std::size_t i = 0; i < bytes.values.size(); ++i) {
    ASSERT_EQ(bytes.values[i],
              std::min(255.0f, std::floor(255.0f * std::sqrt(floats.values[i] / 193.0f) + 0.5f)));
  }
}

TEST(Hks, RefusesWhatDoesNotFit) {
  HksOptions options;
  options.octaves = 2;  // 33 times
  EXPECT_THROW(HksDescriptor{options}, Error);
  options.frequencies = 17;
  const HksDescriptor hks(options);
  const auto surface = test::wrinkled(40, 30, 1, false);
  EXPECT_THROW(hks.describe_surface({}, test::full_mask(surface), {}, 20, 1), Error);
  EXPECT_THROW(hks.describe_surface(surface, test::full_mask(surface), {0, 0, 6, 10, 1}, 20, 1),
               Error);
}

}  // namespace
}  // namespace weft::descriptor
