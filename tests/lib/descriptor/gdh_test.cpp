#include "descriptor/gdh.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "descriptor/geodesic.hpp"
#include "support/files.hpp"
#include "support/slow_marching.hpp"
#include "support/surfaces.hpp"

namespace weft::descriptor {
namespace {

using test::kNoPoint;

// Greatest error of the marched distances against a formula, over a patch.
double march_error_mm(const rgbd::Surface& surface, int patch_px, float max_mm,
                      const std::function<double(int x, int y)>& exact_mm) {
  const SurfaceEdges edges(surface, cv::Rect({}, surface.points_m.size()), 1);
  GeodesicMarcher marcher(edges, patch_px);
  const auto& reached = marcher.march(surface.points_m.cols / 2, surface.points_m.rows / 2, max_mm);
  EXPECT_GT(reached.size(), 100u);
  double worst = 0;
  for (const auto& point : reached)
    worst = std::max(worst, std::abs(point.distance_mm - exact_mm(point.x, point.y)));
  return worst;
}

TEST(Geodesic, IsTheStraightLineOnATiltedPlane) {
  const auto plane = test::surface_of(61, 61, [](int x, int y) {
    return cv::Vec3d(0.0014 * (x - 30), 0.0015 * (y - 30),
                     1.0 + 0.0007 * (x - 30) - 0.0011 * (y - 30));
  });
  const auto exact = [&](int x, int y) {
    return 1000 * cv::norm(cv::Vec3d(plane.points_m.at<cv::Vec3f>(y, x)) - cv::Vec3d(0, 0, 1));
  };
  EXPECT_LT(march_error_mm(plane, 61, 60, exact), 2e-3);
}

TEST(Geodesic, FollowsACylinder) {
  // Lying askew to the grid, 20 mm in radius; seen to 45 degrees around.
  const auto cylinder = test::surface_of(61, 61, [](int x, int y) {
    const double along = (x - 30) * 0.0006 + (y - 30) * 0.0004;
    const double around = ((x - 30) * 0.0004 - (y - 30) * 0.0006) / 0.020;
    const double u = 0.020 * std::sin(around);
    return cv::Vec3d((0.6 * along + 0.4 * u) / std::sqrt(0.52),
                     (0.4 * along - 0.6 * u) / std::sqrt(0.52), 1.0 - 0.020 * std::cos(around));
  });
  const auto exact = [](int x, int y) {
    return 1000 *
           std::hypot((x - 30) * 0.0006 + (y - 30) * 0.0004, (x - 30) * 0.0004 - (y - 30) * 0.0006);
  };
  const double straight =
      1000 * cv::norm(cv::Vec3d(cylinder.points_m.at<cv::Vec3f>(60, 0)) - cv::Vec3d(0, 0, 0.98));
  EXPECT_GT(exact(0, 60) - straight, 0.5);  // else a straight line would pass
  EXPECT_LT(march_error_mm(cylinder, 61, 28, exact), 0.03);
}

TEST(Geodesic, FollowsASphere) {
  const double radius_mm = 30.0;
  const auto sphere = test::surface_of(61, 61, [&](int x, int y) {
    const double u = (x - 30) * 0.7, v = (y - 30) * 0.7;
    const double z = std::sqrt(std::max(1.0, radius_mm * radius_mm - u * u - v * v));
    return cv::Vec3d(u, v, 1000 - z) / 1000.0;
  });
  const auto exact = [&](int x, int y) {
    const double u = (x - 30) * 0.7, v = (y - 30) * 0.7;
    return radius_mm * std::asin(std::hypot(u, v) / radius_mm);
  };
  EXPECT_LT(march_error_mm(sphere, 61, 20, exact), 0.05);
}

TEST(Geodesic, GoesRoundAHole) {
  // A slit from the left edge to x = 40, between the centre and what lies above it.
  auto slit =
      test::surface_of(61, 61, [](int x, int y) { return cv::Vec3d(0.001 * x, 0.001 * y, 1.0); });
  slit.points_m(cv::Rect(0, 24, 41, 1)) = cv::Scalar(kNoPoint[0], kNoPoint[0], kNoPoint[0]);
  const auto exact = [](int x, int y) {
    // Straight, or round the first point right of the slit.
    const cv::Point2d centre(30, 30), end(x, y), corner(41, 24);
    if (y >= 24) return cv::norm(end - centre);
    const double at = centre.x + (end.x - centre.x) * (30.0 - 24) / (30 - y);
    return at >= corner.x ? cv::norm(end - centre)
                          : cv::norm(corner - centre) + cv::norm(end - corner);
  };
  EXPECT_LT(march_error_mm(slit, 61, 40, exact), 0.5);  // half a step of the grid
}

TEST(Geodesic, DoesNotCrossADepthJump) {
  const auto step = test::surface_of(31, 31, [](int x, int y) {
    return cv::Vec3d(0.001 * x, 0.001 * y, x < 20 ? 1.0 : 1.0 - 1.05 * rgbd::kDepthJump);
  });
  const SurfaceEdges edges(step, cv::Rect(0, 0, 31, 31), 1);
  GeodesicMarcher marcher(edges, 31);
  for (const auto& point : marcher.march(15, 15, 100)) EXPECT_LT(point.x, 20);
}

struct Agreement {
  int points = 0, ties = 0;
};

// Compares each grid point's histogram with the slow one.
Agreement expect_agreement(const rgbd::Surface& surface, const Grid& grid, int patch_px,
                           const GdhOptions& options) {
  const auto field =
      GdhDescriptor(options).describe_surface(surface, test::full_mask(surface), grid, patch_px, 2);
  Agreement agreement;
  std::size_t next = 0;
  for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
    const auto slow =
        test::slow_histogram(surface, grid.x(static_cast<int>(cell) % grid.columns),
                             grid.y(static_cast<int>(cell) / grid.columns), patch_px, options);
    EXPECT_EQ(field.state[cell],
              slow.values.empty() ? PointState::kNothing : PointState::kDescribed);
    if (field.state[cell] != PointState::kDescribed) continue;
    const float* values = field.values.data() + next++ * slow.values.size();
    ++agreement.points;
    if (slow.tie) {
      ++agreement.ties;
      continue;
    }
    for (std::size_t k = 0; k < slow.values.size(); ++k)
      EXPECT_NEAR(values[k], slow.values[k], 1e-5) << "cell " << cell << " value " << k;
  }
  EXPECT_EQ(next, field.points.size());
  return agreement;
}

TEST(Gdh, AgreesWithTheDefinition) {
  for (const bool holes : {false, true}) {
    for (const int patch_px : {21, 40}) {
      GdhOptions options;
      options.min_points = 30;
      const auto surface = test::wrinkled(70, 60, 5, holes);
      const Grid grid = make_grid(70, 60, {11, 0});  // patches overhang the image
      const auto agreement = expect_agreement(surface, grid, patch_px, options);
      EXPECT_GT(agreement.points, 35);
      EXPECT_LT(agreement.ties, agreement.points / 4);
    }
  }
}

TEST(Gdh, AgreesWithTheDefinitionOnRealScans) {
  struct Crop {
    const char* name;
    cv::Rect crop;
    double geodesic_max_mm;
  };
  // A room some metres away, and a towel on the floor.
  for (const auto& [name, crop, geodesic_max_mm] :
       {Crop{"pcl-scans/office1.pcd", {200, 180, 120, 100}, 60.0},
        Crop{"uc3m-garments/pcd/20150902_towel02_2_fold.pcd", {260, 180, 120, 100}, 28.0}}) {
    const auto path = (test::data_folder() / name).string();
    WEFT_NEEDS_DATA(path);
    rgbd::Surface surface = test::read_surface(path);
    surface.points_m = surface.points_m(crop);
    GdhOptions options;
    options.geodesic_max_mm = geodesic_max_mm;
    options.min_points = 20;
    const auto agreement = expect_agreement(surface, make_grid(120, 100, {17, 20}), 41, options);
    EXPECT_GT(agreement.points, 10) << name;
    EXPECT_LT(agreement.ties, agreement.points / 2) << name;
  }
}

TEST(Gdh, IsTheSameForEachNumberOfThreads) {
  const auto surface = test::wrinkled(160, 120, 3, true);
  const Grid grid = make_grid(160, 120, {6, 3});
  const GdhDescriptor gdh({});
  const auto expected = gdh.describe_surface(surface, test::full_mask(surface), grid, 41, 1);
  ASSERT_GT(expected.points.size(), 300u);
  for (const int threads : {2, 3}) {
    const auto field = gdh.describe_surface(surface, test::full_mask(surface), grid, 41, threads);
    EXPECT_EQ(field.points, expected.points);
    EXPECT_EQ(field.values, expected.values);
  }
}

TEST(Gdh, SeesNothingWhereThereIsNone) {
  GdhOptions options;
  options.min_points = 30;
  const GdhDescriptor gdh(options);
  // One point, all of them missing, all infinite.
  for (const float z :
       {1.0f, std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    for (const int size : {1, 30}) {
      if (size == 30 && z == 1.0f) continue;
      const auto surface = test::surface_of(
          size, size, [&](int x, int y) { return cv::Vec3d(x * 1e-3, y * 1e-3, z); });
      const auto field = gdh.describe_surface(surface, test::full_mask(surface),
                                              make_grid(size, size, {6, 0}), 41, 1);
      EXPECT_TRUE(field.points.empty());
      for (const auto state : field.state) EXPECT_EQ(state, PointState::kNothing);
    }
  }
  // An island around the centre, a missing centre, a point outside the mask.
  auto surface =
      test::surface_of(60, 20, [](int x, int y) { return cv::Vec3d(0.001 * x, 0.001 * y, 1.0); });
  surface.points_m(cv::Rect(7, 7, 7, 7)) = cv::Scalar(kNoPoint[0], kNoPoint[0], kNoPoint[0]);
  surface.points_m(cv::Rect(8, 8, 5, 5)) = cv::Scalar(0.01, 0.01, 1.0);
  surface.points_m.at<cv::Vec3f>(10, 30) = kNoPoint;
  cv::Mat mask = test::full_mask(surface);
  mask.at<std::uint8_t>(10, 50) = 0;
  const Grid grid{10, 10, 10, 5, 1};
  const auto field = gdh.describe_surface(surface, mask, grid, 41, 1);
  const std::vector<PointState> expected = {PointState::kNothing, PointState::kDescribed,
                                            PointState::kNothing, PointState::kDescribed,
                                            PointState::kOutsideMask};
  EXPECT_EQ(field.state, expected);
  for (const float v : field.values) EXPECT_TRUE(std::isfinite(v));
}

TEST(Gdh, IsMetricInTheRectifiedView) {
  rgbd::View view;
  EXPECT_EQ(patch_size_px(view, 41, 55), 41);
  view.kind = rgbd::View::Kind::kRectified;
  view.scale_px_per_m = 600;
  EXPECT_EQ(patch_size_px(view, 41, 55), 33);
  view.scale_px_per_m = 4000;
  EXPECT_THROW(patch_size_px(view, 41, 500), Error);
}

TEST(Gdh, RoundsToBytes) {
  const auto surface = test::wrinkled(80, 80, 9, false);
  const rgbd::CameraModel camera{80, 80, 525, 525, 40, 40};
  rgbd::RgbdFrame frame;
  frame.camera = camera;
  frame.colour.create(80, 80, CV_8UC3);
  frame.depth.create(80, 80, CV_16UC1);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 80; ++x)
      frame.depth.at<std::uint16_t>(y, x) =
          static_cast<std::uint16_t>(std::lround(1000 * surface.points_m.at<cv::Vec3f>(y, x)[2]));
  const cv::Mat mask(80, 80, CV_8UC1, cv::Scalar(255));
  rgbd::ViewOptions sensor;
  sensor.rectified = false;
  const auto view = rgbd::make_view(frame, mask, nullptr, sensor);
  const Grid grid = make_grid(80, 80, {});
  DescriptorOptions options;
  options.kind = DescriptorOptions::Kind::kGdh;
  const auto gdh = make_descriptor(options);
  EXPECT_EQ(gdh->name(), "gdh");
  EXPECT_EQ(gdh->dimension(), 88);
  const auto bytes = gdh->describe(frame, view, {frame.colour, mask}, grid, 1);
  const auto floats =
      GdhDescriptor({}).describe_surface(rgbd::render_surface(frame, view), mask, grid, 41, 1);
  ASSERT_EQ(bytes.points, floats.points);
  ASSERT_GT(bytes.values.size(), 88u * 50);
  ASSERT_EQ(bytes.values.size(), floats.values.size());
  for (std::size_t i = 0; i < bytes.values.size(); ++i)
    ASSERT_EQ(bytes.values[i], std::min(255.0f, std::floor(512 * floats.values[i] + 0.5f)));
}

TEST(Gdh, RefusesWhatDoesNotFit) {
  const auto surface = test::wrinkled(40, 30, 1, false);
  const GdhDescriptor gdh({});
  const cv::Mat mask = test::full_mask(surface);
  EXPECT_THROW(gdh.describe_surface({}, mask, {}, 41, 1), Error);
  EXPECT_THROW(gdh.describe_surface(surface, mask.rowRange(0, 20), {}, 41, 1), Error);
  EXPECT_THROW(gdh.describe_surface(surface, mask, {0, 0, 6, 10, 1}, 41, 1), Error);
  GdhOptions options;
  options.depth_bins = 0;
  EXPECT_THROW(GdhDescriptor{options}, Error);
}

}  // namespace
}  // namespace weft::descriptor
