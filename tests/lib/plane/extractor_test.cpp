#include "plane/extractor.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "support/files.hpp"
#include "support/plane_scene.hpp"

namespace weft::plane {
namespace {

using test::overlap;

double degrees(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180.0 / M_PI;
}

/// What holds for every extraction.
void check(const Extraction& found, const rgbd::RgbdFrame& frame) {
  ASSERT_EQ(found.labels.type(), CV_8UC1);
  ASSERT_EQ(found.labels.size(), frame.depth.size());
  double largest = 0.0;
  cv::minMaxLoc(found.labels, nullptr, &largest);
  EXPECT_LE(largest, static_cast<double>(found.planes.size() + found.cylinders.size()));
  EXPECT_EQ(cv::countNonZero((found.labels > 0) & (frame.depth == 0)), 0);
  int label = 0, last = found.labels.rows * found.labels.cols;
  for (const PlaneSegment& s : found.planes) {
    EXPECT_EQ(s.plane.support, cv::countNonZero(found.labels == ++label));
    EXPECT_LE(s.plane.support, last);
    last = s.plane.support;
    EXPECT_NEAR(s.plane.normal.norm(), 1.0, 1e-12);
    EXPECT_LT(s.plane.distance_m, 0.0);
    ASSERT_EQ(static_cast<int>(s.points_camera.size()), s.cells);
    for (const Eigen::Vector3f& p : s.points_camera)
      EXPECT_NEAR(s.plane.height_m(p.cast<double>()), 0.0, 1e-5);
    EXPECT_EQ(s.covariance, s.covariance.transpose());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(s.covariance);
    EXPECT_GE(solver.eigenvalues()[0], 0.0);
  }
  last = found.labels.rows * found.labels.cols;
  for (const CylinderSegment& s : found.cylinders) {
    EXPECT_EQ(s.support, cv::countNonZero(found.labels == ++label));
    EXPECT_LE(s.support, last);
    last = s.support;
    EXPECT_NEAR(s.axis.norm(), 1.0, 1e-12);
    ASSERT_EQ(static_cast<int>(s.points_camera.size()), s.cells);
    for (const Eigen::Vector3f& p : s.points_camera)
      EXPECT_NEAR(s.axis.cross(p.cast<double>() - s.point_camera).norm(), s.radius_m, 0.02);
  }
}

Extraction extract(const rgbd::RgbdFrame& frame, const ExtractorOptions& options = {},
                   SimdPath path = SimdPath::kAuto) {
  Extraction found = Extractor(options, path).extract(frame);
  check(found, frame);
  return found;
}

bool same(const Extraction& a, const Extraction& b) {
  if (cv::norm(a.labels, b.labels, cv::NORM_INF) != 0.0) return false;
  if (a.planes.size() != b.planes.size() || a.cylinders.size() != b.cylinders.size()) return false;
  for (std::size_t i = 0; i < a.planes.size(); ++i) {
    const PlaneSegment &p = a.planes[i], &q = b.planes[i];
    if (p.plane.normal != q.plane.normal || p.plane.distance_m != q.plane.distance_m ||
        p.plane.rms_m != q.plane.rms_m || p.covariance != q.covariance ||
        p.points_camera != q.points_camera)
      return false;
  }
  for (std::size_t i = 0; i < a.cylinders.size(); ++i) {
    const CylinderSegment &p = a.cylinders[i], &q = b.cylinders[i];
    if (p.point_camera != q.point_camera || p.axis != q.axis || p.radius_m != q.radius_m)
      return false;
  }
  return true;
}

/// Every wall is one segment, within the bounds, and there is nothing else.
void expect_walls(const test::PlaneScene& scene, double max_degrees, double max_mm,
                  double min_overlap) {
  const auto view = test::render(scene);
  const Extraction found = extract(view.frame);
  ASSERT_EQ(found.planes.size(), scene.walls.size());
  EXPECT_TRUE(found.cylinders.empty());
  for (std::size_t w = 0; w < scene.walls.size(); ++w) {
    const cv::Mat truth = view.truth == static_cast<int>(w) + 1;
    double best = 0.0;
    std::size_t which = 0;
    for (std::size_t s = 0; s < found.planes.size(); ++s) {
      const double o = overlap(truth, found.labels == static_cast<int>(s) + 1);
      if (o > best) {
        best = o;
        which = s;
      }
    }
    EXPECT_GE(best, min_overlap) << "wall " << w;
    const rgbd::Plane& plane = found.planes[which].plane;
    EXPECT_LT(degrees(plane.normal, scene.walls[w].normal), max_degrees) << "wall " << w;
    EXPECT_NEAR(plane.distance_m, scene.walls[w].distance_m, 1e-3 * max_mm) << "wall " << w;
  }
}

TEST(Extractor, FindsTheWallsOfARoom) { expect_walls(test::room(), 0.01, 0.1, 0.99); }

TEST(Extractor, FindsThemInNoise) {
  auto scene = test::room();
  scene.noise_per_m = 0.0015;
  scene.depth_unit_m = 0.001;
  expect_walls(scene, 0.1, 1.5, 0.97);
  scene.noise_per_m = 0.0006;
  scene.common_per_m = 0.001;
  scene.block_px = 5;
  expect_walls(scene, 0.2, 3.0, 0.97);
}

TEST(Extractor, FindsThemBetweenHoles) {
  auto scene = test::room();
  scene.noise_per_m = 0.001;
  scene.holes_share = 0.3;
  expect_walls(scene, 0.1, 1.5, 0.95);
}

TEST(Extractor, FindsThemAtOddSizes) {
  for (const auto& [width, height] : {std::pair{637, 477}, {333, 251}, {161, 243}}) {
    auto scene = test::room();
    const double scale = width / 640.0;
    scene.camera = {width, height, 525.0 * scale, 525.0 * scale, width / 2.0, height / 2.0};
    expect_walls(scene, 0.05, 0.5, 0.95);
  }
}

TEST(Extractor, TellsStepsApart) {
  // A shelf board of 30 x 20 cm, 25 mm before a wall at 1 m.
  test::PlaneScene scene;
  scene.noise_per_m = 0.0012;
  const Eigen::Vector3d normal = Eigen::Vector3d(0.1, 0.05, -1.0).normalized();
  scene.walls = {{normal, -1.0}, {normal, -0.975, [](const Eigen::Vector3d& p) {
                                    return std::abs(p.x()) < 0.15 && std::abs(p.y()) < 0.1;
                                  }}};
  expect_walls(scene, 0.3, 1.0, 0.95);
}

TEST(Extractor, JoinsAWallBehindAPole) {
  test::PlaneScene scene;
  scene.walls = {{{0, 0, -1}, -2.0}, {{0, 0, -1}, -1.0, [](const Eigen::Vector3d& p) {
                                        return std::abs(p.x()) < 0.1;
                                      }}};
  const auto view = test::render(scene);
  EXPECT_EQ(extract(view.frame).planes.size(), 2u);
  ExtractorOptions apart;
  apart.merge_apart = false;
  const auto found = extract(view.frame, apart);
  ASSERT_EQ(found.planes.size(), 3u);
  for (std::size_t i : {0u, 1u}) EXPECT_NEAR(found.planes[i].plane.distance_m, -2.0, 1e-3);
}

TEST(Extractor, ReachesIntoCellsWithoutAPlaneOfTheirOwn) {
  // Bars of 8 px, 12 px apart, over the lower half of a wall: no cell there is flat.
  test::PlaneScene scene;
  scene.walls = {{{0, 0, -1}, -2.0}, {{0, 0, -1}, -1.0, [](const Eigen::Vector3d& p) {
                                        const double u = p.x() * 525.0 + 320.0;
                                        return p.y() > 0.0 && u - 20.0 * std::floor(u / 20.0) < 8.0;
                                      }}};
  const auto view = test::render(scene);
  const auto found = extract(view.frame);
  ASSERT_EQ(found.planes.size(), 1u);
  EXPECT_GE(overlap(view.truth == 1, found.labels == 1), 0.99);
}

TEST(Extractor, FindsCylinders) {
  for (const bool hollow : {false, true})
    for (const double noise : {0.0, 0.0012}) {
      test::PlaneScene scene;
      scene.noise_per_m = noise;
      scene.walls = {{{0, 0, -1}, -2.0}};
      scene.tubes = {{{0.05, 0.0, 1.1}, {0.3, 1.0, 0.1}, 0.16, 0.3, hollow}};
      const auto view = test::render(scene);
      const Extraction found = extract(view.frame);
      ASSERT_EQ(found.cylinders.size(), 1u) << hollow << noise;
      const CylinderSegment& tube = found.cylinders[0];
      EXPECT_NEAR(tube.radius_m, 0.16, noise > 0.0 ? 0.006 : 0.003);
      EXPECT_EQ(tube.convex, !hollow);
      EXPECT_GT(std::abs(tube.axis.dot(scene.tubes[0].axis.normalized())),
                std::cos(2.0 * M_PI / 180));
      EXPECT_LT(
          scene.tubes[0].axis.normalized().cross(tube.point_camera - scene.tubes[0].point).norm(),
          0.006);
      const int label = static_cast<int>(found.planes.size()) + 1;
      EXPECT_GE(overlap(view.truth == 2, found.labels == label), 0.85);
      ExtractorOptions none;
      none.cylinders = false;
      EXPECT_TRUE(extract(view.frame, none).cylinders.empty());
    }
}

TEST(Extractor, SeesNothingWhereNothingIs) {
  for (const auto& [width, height] : {std::pair{1, 1}, {1, 480}, {7, 5}, {640, 480}}) {
    rgbd::RgbdFrame frame;
    frame.camera = {width, height, 525.0, 525.0, 1.0, 1.0};
    for (const int depth : {0, 1, 900, 65535}) {
      frame.depth = cv::Mat(height, width, CV_16UC1, cv::Scalar(depth));
      const bool wall = width == 640 && depth == 900;
      EXPECT_EQ(extract(frame).planes.size(), wall ? 1u : 0u);
    }
  }
  // Noise without a surface.
  rgbd::RgbdFrame frame;
  frame.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
  frame.depth.create(480, 640, CV_16UC1);
  Random random(1);
  for (int i = 0; i < 640 * 480; ++i)
    frame.depth.ptr<std::uint16_t>()[i] = static_cast<std::uint16_t>(random.below(65536));
  EXPECT_TRUE(extract(frame).planes.empty());
}

TEST(Extractor, KeepsTheLargest255) {
  // A step of at least 30 mm between all cells, each a plane: 600 of 16 px, 300 of 32 x 16.
  rgbd::RgbdFrame frame;
  frame.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
  frame.depth.create(480, 640, CV_16UC1);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u) {
      const int column = v < 240 ? u / 16 : 1000 + u / 32, row = v / 16;
      const int mix = (column * 7919 + row * 104729) % 97;
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(1000 + 31 * mix);
    }
  ExtractorOptions options;
  options.cell_px = 16;
  options.min_cells = 1;
  options.merge_apart = false;
  const auto found = extract(frame, options);
  EXPECT_EQ(found.planes.size(), 255u);
  EXPECT_GE(found.planes.back().plane.support, 32 * 16);
}

TEST(Extractor, GivesTheSameBitsOnEveryPath) {
  auto scene = test::room();
  scene.noise_per_m = 0.0015;
  scene.holes_share = 0.05;
  scene.tubes = {{{0.2, 0.0, 1.4}, {0.0, 1.0, 0.2}, 0.15, 0.4}};
  scene.camera.width = 635;
  const auto view = test::render(scene);
  const auto baseline = extract(view.frame, {}, SimdPath::kBaseline);
  EXPECT_EQ(baseline.cylinders.size(), 1u);
  EXPECT_TRUE(same(baseline, extract(view.frame, {}, SimdPath::kBaseline)));
  if (simd_path_available(SimdPath::kAvx2)) {
    EXPECT_TRUE(same(baseline, extract(view.frame, {}, SimdPath::kAvx2)));
  }
  // The depth image may be a part of another one.
  cv::Mat large(490, 700, CV_16UC1, cv::Scalar(1234));
  cv::Mat part = large(cv::Rect(31, 5, 635, 480));
  view.frame.depth.copyTo(part);
  rgbd::RgbdFrame cut = view.frame;
  cut.depth = part;
  EXPECT_TRUE(same(baseline, extract(cut)));
}

/// Deviation of a plane from the truth in the terms of its covariance.
Eigen::Vector3d deviation(const rgbd::Plane& plane, const test::Wall& wall) {
  const auto [e0, e1] = tangent_basis(plane.normal);
  return {e0.dot(wall.normal), e1.dot(wall.normal), wall.distance_m - plane.distance_m};
}

struct Trials {
  Eigen::Matrix3d sample = Eigen::Matrix3d::Zero(), predicted = Eigen::Matrix3d::Zero();
  double chi_squared = 0.0;
};

Trials run_trials(test::PlaneScene scene, int count) {
  Trials trials;
  ExtractorOptions options;
  options.margin_m = 0.1;
  for (int trial = 0; trial < count; ++trial) {
    scene.seed = static_cast<std::uint64_t>(trial) + 1;
    const auto found = Extractor(options).extract(test::render(scene).frame);
    EXPECT_EQ(found.planes.size(), 1u);
    EXPECT_EQ(found.planes[0].cells, 48);
    const Eigen::Vector3d d = deviation(found.planes[0].plane, scene.walls[0]);
    trials.sample += d * d.transpose() / count;
    trials.predicted += found.planes[0].covariance / count;
    trials.chi_squared += d.dot(found.planes[0].covariance.inverse() * d) / count;
  }
  return trials;
}

test::PlaneScene one_wall() {
  test::PlaneScene scene;
  scene.camera = {160, 120, 131.0, 131.0, 79.5, 59.5};
  scene.walls = {{Eigen::Vector3d(0.4, -0.5, -1.0).normalized(), -1.2}};
  scene.depth_unit_m = 0.0001;
  return scene;
}

TEST(Extractor, CovarianceIsThatOfNoiseSharedByACell) {
  auto scene = one_wall();
  scene.common_per_m = 0.004;
  const Trials trials = run_trials(scene, 400);
  const Eigen::Vector3d sigma = trials.sample.diagonal().cwiseSqrt();
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      EXPECT_NEAR(trials.predicted(i, j) / (sigma[i] * sigma[j]),
                  trials.sample(i, j) / (sigma[i] * sigma[j]), 0.2)
          << i << j;
  EXPECT_NEAR(trials.chi_squared, 3.0, 0.5);
}

TEST(Extractor, CovarianceIsCautiousWhereNoiseIsIndependent) {
  auto scene = one_wall();
  scene.noise_per_m = 0.004;
  const Trials trials = run_trials(scene, 60);
  // 400 pixels of a cell average the noise; the covariance does not count on it.
  EXPECT_NEAR(trials.chi_squared * 400.0, 3.0, 1.2);
}

TEST(Extractor, RefusesWhatItCannotRead) {
  const auto refused = [](auto change) {
    auto frame = test::render(one_wall()).frame;
    change(frame);
    return test::error_of([&] { Extractor({}).extract(frame); });
  };
  EXPECT_EQ(refused([](auto&) {}), "");
  EXPECT_NE(refused([](auto& f) { f.depth = f.depth.rowRange(0, 50); }).find("camera's size"),
            std::string::npos);
  EXPECT_NE(refused([](auto& f) { f.depth.convertTo(f.depth, CV_32F); }).find("16 bit"),
            std::string::npos);
  EXPECT_NE(refused([](auto& f) { f.depth_unit_m = 0.0; }).find("depth unit"), std::string::npos);
  EXPECT_NE(refused([](auto& f) { f.camera.fx = 0.0; }).find("fx"), std::string::npos);
  ExtractorOptions options;
  options.min_depth_m = options.max_depth_m = 2.0;
  EXPECT_THROW(Extractor{options}, Error);
  options = {};
  options.cell_px = 41;
  EXPECT_THROW(Extractor{options}, Error);
}

}  // namespace
}  // namespace weft::plane
