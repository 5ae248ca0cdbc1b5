#include "descriptor/fpfh.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "support/fpfh_scenes.hpp"
#include "support/slow_fpfh.hpp"
#include "support/table_scene.hpp"

namespace weft::descriptor {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

cv::Mat everywhere(const cv::Mat& image) { return cv::Mat(image.size(), CV_8UC1, cv::Scalar(255)); }

FpfhOptions options_with(double radius_m, int min_neighbours = 1) {
  FpfhOptions options;
  options.radius_m = radius_m;
  options.min_neighbours = min_neighbours;
  return options;
}

void expect_definition(const rgbd::Surface& surface, const cv::Mat& normals, double radius_m,
                       const Grid& grid) {
  const auto mask = everywhere(normals);
  const auto field =
      FpfhDescriptor(options_with(radius_m)).describe_surface(surface, normals, mask, grid, 2);
  test::SlowFpfh slow(surface, normals, radius_m);
  std::size_t found = 0;
  int without_ties = 0;
  std::vector<double> errors;
  for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
    const int x = grid.x(static_cast<int>(cell) % grid.columns);
    const int y = grid.y(static_cast<int>(cell) / grid.columns);
    const auto expected = slow.at(x, y);
    ASSERT_EQ(expected.has_value(), field.state[cell] == PointState::kDescribed) << x << ", " << y;
    if (!expected) continue;
    ASSERT_EQ(field.points[found], static_cast<std::int32_t>(cell));
    without_ties += expected->ties < 0.1;
    for (std::size_t k = 0; k < 33; ++k) {
      const double error = std::abs(field.values[found * 33 + k] - expected->values[k]);
      errors.push_back(error);
      EXPECT_LE(error, 1e-3 + expected->ties) << "at " << x << ", " << y << ", value " << k;
    }
    ++found;
  }
  EXPECT_EQ(found, field.points.size());
  EXPECT_GT(found, grid.cells() / 2);
  EXPECT_GT(without_ties, static_cast<int>(found) / 2);  // else this says little
  std::sort(errors.begin(), errors.end());
  EXPECT_LT(errors[errors.size() * 999 / 1000], 0.1);
}

TEST(Fpfh, AgreesWithTheDefinition) {
  for (const double radius_m : {0.025, 0.011}) {
    const auto view = test::render(test::folded_cloth(93, 71));
    const auto normals = rgbd::estimate_normals(view.surface, {}, 1);
    expect_definition(view.surface, normals, radius_m, make_grid(93, 71, {11, 3}));
  }
}

// Near the camera a row of offsets is longer than what the kernel takes at once.
TEST(Fpfh, AgreesWithTheDefinitionNearTheCamera) {
  auto scene = test::folded_cloth(150, 12);
  scene.distance_m = 0.25;
  scene.layers.pop_back();
  const auto view = test::render(scene);
  expect_definition(view.surface, view.normals, 0.025, make_grid(150, 12, {9, 2}));
}

void expect_definition_on_scan(const char* scan, cv::Rect part) {
  const auto path = test::data_folder() / scan;
  WEFT_NEEDS_DATA(path);
  const auto surface = test::scan_part(path, part);
  const auto normals = rgbd::estimate_normals(surface, {}, 1);
  expect_definition(surface, normals, 0.025, make_grid(part.width, part.height, {13, 5}));
}
TEST(Fpfh, AgreesWithTheDefinitionOnTowel) {
  expect_definition_on_scan(test::kTowelScan, {280, 180, 90, 70});
}
TEST(Fpfh, AgreesWithTheDefinitionOnOffice) {
  expect_definition_on_scan(test::kOfficeScan, {200, 200, 130, 90});
}

// Values that follow from geometry alone.
TEST(Fpfh, PlaneAndSphere) {
  test::AnalyticScene scene;
  scene.camera = {120, 100, 525.0, 525.0, 59.5, 49.5};
  scene.noise_px = scene.step_px = scene.stray_px = 0.0;
  scene.holes = scene.missing_px = 0;
  const auto plane = test::render(scene);
  const FpfhDescriptor fpfh(options_with(0.02));
  const Grid grid = make_grid(120, 100, {});
  const auto mask = everywhere(plane.normals);
  const auto flat = fpfh.describe_surface(plane.surface, plane.normals, mask, grid, 1);
  ASSERT_EQ(flat.points.size(), grid.cells());
  for (std::size_t i = 0; i < flat.values.size(); ++i)
    EXPECT_NEAR(flat.values[i], i % 11 == 5 ? 100.0f : 0.0f, 1e-4f);

  // Points of a sphere of radius R at distance d: u . d / |d| = -d / 2R, n turned by 2 asin(d / 2R)
  // towards the other side; no twist. At d < 2 cm and R = 5 cm: |f3| < 0.2, |f1| < 0.4.
  auto sphere = plane;
  const Eigen::Vector3d centre(0, 0, 0.6);
  for (int y = 0; y < 100; ++y) {
    for (int x = 0; x < 120; ++x) {
      const Eigen::Vector3d ray = scene.camera.unproject(x, y, 1.0).normalized();
      const double along = ray.dot(centre);
      const double inside = 0.05 * 0.05 - (centre.squaredNorm() - along * along);
      const Eigen::Vector3d p = ray * (along - std::sqrt(std::max(0.0, inside)));
      const Eigen::Vector3d n = (p - centre).normalized();
      auto& point = sphere.surface.points_m.at<cv::Vec3f>(y, x);
      point =
          inside < 1e-4 ? cv::Vec3f(kNan, kNan, kNan) : cv::Vec3f(cv::Vec3d(p.x(), p.y(), p.z()));
      sphere.normals.at<cv::Vec3f>(y, x) = cv::Vec3f(cv::Vec3d(n.x(), n.y(), n.z()));
    }
  }
  const auto round = fpfh.describe_surface(sphere.surface, sphere.normals, mask, grid, 1);
  ASSERT_GT(round.points.size(), 30u);
  for (std::size_t i = 0; i < round.points.size(); ++i) {
    const float* v = round.values.data() + 33 * i;
    EXPECT_NEAR(v[11 + 5], 100.0f, 1e-3f);  // no twist
    EXPECT_NEAR(v[22 + 4] + v[22 + 5], 100.0f, 1e-3f);
    EXPECT_GT(v[22 + 4], 5.0f);  // d > 0.91 cm: f3 < -1/11
    EXPECT_NEAR(v[5] + v[6], 100.0f, 1e-3f);
    EXPECT_GT(v[6], 5.0f);  // 2 asin(d / 2R) > pi / 11
  }
}

TEST(Fpfh, SameBitsOnEveryPathAndThreadCount) {
  if (!simd_path_available(SimdPath::kAvx2)) GTEST_SKIP() << "AVX2: this processor has none";
  for (const int width : {67, 150}) {
    const auto view = test::render(test::folded_cloth(width, 80));
    const auto normals = rgbd::estimate_normals(view.surface, {}, 1);
    for (const double radius_m : {0.025, 0.04}) {
      const Grid grid = make_grid(width, 80, {5, 2});
      const auto mask = everywhere(normals);
      const auto options = options_with(radius_m);
      const auto expected = FpfhDescriptor(options, SimdPath::kBaseline)
                                .describe_surface(view.surface, normals, mask, grid, 1);
      ASSERT_GT(expected.points.size(), grid.cells() / 2);
      for (const auto path : {SimdPath::kBaseline, SimdPath::kAvx2}) {
        for (const int threads : {1, 2, 3, 40}) {
          const auto field = FpfhDescriptor(options, path)
                                 .describe_surface(view.surface, normals, mask, grid, threads);
          EXPECT_EQ(field.points, expected.points);
          EXPECT_EQ(field.values, expected.values);
        }
      }
    }
  }
}

TEST(Fpfh, InsideTheMaskTheSameAsWithoutOne) {
  test::TableScene scene;
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  scene.colour = [](double x, double y, bool) { return test::white(x, y); };
  const auto frame = scene.render();
  rgbd::ViewOptions view_options;
  for (const bool rectified : {false, true}) {
    view_options.rectified = rectified;
    const auto table = scene.table();
    const auto view = rgbd::make_view(frame, frame.mask, &table, view_options);
    auto images = rgbd::render_view(frame, frame.mask, view);
    const Grid grid = make_grid(view.width, view.height, {12, 6});
    const FpfhDescriptor fpfh(options_with(0.025, 10));
    const auto some = fpfh.describe(frame, view, images, grid, 2);
    const auto surface = rgbd::render_surface(frame, view);
    const auto normals = rgbd::estimate_normals(surface, {}, 1);
    const auto all = fpfh.describe_surface(surface, normals, everywhere(surface.points_m), grid, 1);
    std::size_t i = 0, found = 0;
    for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
      const int x = grid.x(static_cast<int>(cell) % grid.columns);
      const int y = grid.y(static_cast<int>(cell) / grid.columns);
      const bool inside = images.mask.at<std::uint8_t>(y, x) != 0;
      EXPECT_EQ(some.state[cell], inside ? all.state[cell] : PointState::kOutsideMask);
      if (all.state[cell] != PointState::kDescribed) continue;
      if (inside) {
        ASSERT_LT(found, some.points.size());
        ASSERT_EQ(some.points[found], static_cast<std::int32_t>(cell));
        for (std::size_t k = 0; k < 33; ++k) {
          EXPECT_EQ(some.values[found * 33 + k],
                    std::min(255.0, std::floor(2.55 * double{all.values[i * 33 + k]} + 0.5)));
        }
        ++found;
      }
      ++i;
    }
    EXPECT_EQ(found, some.points.size());
    EXPECT_GT(found, 300u);
  }
}

// Every point of `surface` in one grid.
FloatField describe_all(const rgbd::Surface& surface, const cv::Mat& normals, int min_neighbours) {
  const Grid grid{0, 0, 1, surface.points_m.cols, surface.points_m.rows};
  return FpfhDescriptor(options_with(0.025, min_neighbours))
      .describe_surface(surface, normals, everywhere(normals), grid, 3);
}

TEST(Fpfh, NothingWhereThereIsNothing) {
  auto scene = test::folded_cloth(40, 30);
  scene.holes = scene.missing_px = 0;
  scene.layers.pop_back();
  const auto scan = test::render(scene);
  const auto copy = [&] {
    auto view = scan;
    view.surface.points_m = scan.surface.points_m.clone();
    view.normals = scan.normals.clone();
    return view;
  };
  const auto missing = cv::Vec3f(kNan, kNan, kNan);
  auto lonely = copy();  // one point, two that are neighbours, and one beside them without normal
  lonely.surface.points_m = cv::Scalar::all(kNan);
  for (const auto& at : {cv::Point(4, 4), cv::Point(20, 20), cv::Point(21, 20), cv::Point(20, 21)})
    lonely.surface.points_m.at<cv::Vec3f>(at) = scan.surface.points_m.at<cv::Vec3f>(at);
  lonely.normals.at<cv::Vec3f>(21, 20) = missing;
  const auto two = describe_all(lonely.surface, lonely.normals, 1);
  EXPECT_EQ(two.points, (std::vector<std::int32_t>{20 * 40 + 20, 20 * 40 + 21}));
  EXPECT_EQ(two.state[4 * 40 + 4], PointState::kNothing);
  for (const float value : two.values) EXPECT_TRUE(value == 0.0f || value == 100.0f);
  EXPECT_TRUE(describe_all(lonely.surface, lonely.normals, 2).points.empty());

  auto empty = copy();
  empty.surface.points_m = cv::Scalar::all(kNan);
  EXPECT_TRUE(describe_all(empty.surface, empty.normals, 1).points.empty());
  auto flat = copy();
  flat.normals = cv::Scalar::all(kNan);
  EXPECT_TRUE(describe_all(flat.surface, flat.normals, 1).points.empty());
  // Infinitely far, behind the camera, at its centre: missing, and no harm to the rest.
  auto odd = copy();
  const float infinity = std::numeric_limits<float>::infinity();
  const std::vector<cv::Vec3f> odd_points = {{0, 0, infinity},  {infinity, 0, 1},     {0, 0, -1},
                                             {0, 0, 0},         {0, 0, 1e-30f},       {0, 0, 0.05f},
                                             {0, -infinity, 1}, {1e38f, 1e38f, 1e38f}};
  auto holes = copy();
  for (int i = 0; i < static_cast<int>(odd_points.size()); ++i) {
    odd.surface.points_m.at<cv::Vec3f>(10 + i, 15) = odd_points[static_cast<std::size_t>(i)];
    holes.surface.points_m.at<cv::Vec3f>(10 + i, 15) = missing;
  }
  odd.normals.at<cv::Vec3f>(25, 5) = {infinity, 0, 0};
  holes.normals.at<cv::Vec3f>(25, 5) = missing;
  const auto with_odd = describe_all(odd.surface, odd.normals, 1);
  const auto with_holes = describe_all(holes.surface, holes.normals, 1);
  EXPECT_EQ(with_odd.state, with_holes.state);
  EXPECT_EQ(with_odd.points, with_holes.points);
  EXPECT_EQ(with_odd.values, with_holes.values);
  EXPECT_GT(with_odd.points.size(), 1000u);
}

TEST(Fpfh, MinNeighboursArePairsOfThePoint) {
  const auto view = test::render(test::folded_cloth(60, 50));
  const auto normals = rgbd::estimate_normals(view.surface, {}, 1);
  const auto all = describe_all(view.surface, normals, 1);
  const auto some = describe_all(view.surface, normals, 250);
  test::SlowFpfh slow(view.surface, normals, 0.025);
  int described = 0;
  for (int cell = 0; cell < 60 * 50; cell += 37) {
    const auto expected = slow.at(cell % 60, cell / 60);
    const auto state = some.state[static_cast<std::size_t>(cell)];
    EXPECT_EQ(state == PointState::kDescribed, expected && expected->pairs >= 250);
    described += state == PointState::kDescribed;
  }
  EXPECT_GT(described, 10);
  EXPECT_LT(some.points.size(), all.points.size());
}

TEST(Fpfh, OnePixel) {
  rgbd::RgbdFrame frame;
  frame.camera = {1, 1, 500.0, 500.0, 0.0, 0.0};
  frame.depth = cv::Mat(1, 1, CV_16UC1, cv::Scalar(800));
  const cv::Mat mask(1, 1, CV_8UC1, cv::Scalar(255));
  rgbd::ViewOptions sensor;
  sensor.rectified = false;
  const auto view = rgbd::make_view(frame, mask, nullptr, sensor);
  const auto field =
      FpfhDescriptor(FpfhOptions{}).describe(frame, view, {{}, mask}, {0, 0, 1, 1, 1}, 2);
  EXPECT_EQ(field.state, std::vector{PointState::kNothing});
}

TEST(Fpfh, RefusesWhatDoesNotFit) {
  const auto view = test::render(test::folded_cloth(40, 30));
  const FpfhDescriptor fpfh{FpfhOptions{}};
  const auto mask = everywhere(view.normals);
  const Grid grid = make_grid(40, 30, {});
  EXPECT_NO_THROW(fpfh.describe_surface(view.surface, view.normals, mask, grid, 1));
  EXPECT_THROW(fpfh.describe_surface(view.surface, cv::Mat(), mask, grid, 1), Error);
  EXPECT_THROW(fpfh.describe_surface(view.surface, view.normals.rowRange(0, 9), mask, grid, 1),
               Error);
  EXPECT_THROW(fpfh.describe_surface(view.surface, view.normals, mask.rowRange(0, 9), grid, 1),
               Error);
  EXPECT_THROW(fpfh.describe_surface(view.surface, view.normals, mask, make_grid(80, 30, {}), 1),
               Error);
  auto other_camera = view.surface;
  other_camera.camera.width = 50;
  EXPECT_THROW(fpfh.describe_surface(other_camera, view.normals, mask, grid, 1), Error);
}

}  // namespace
}  // namespace weft::descriptor
