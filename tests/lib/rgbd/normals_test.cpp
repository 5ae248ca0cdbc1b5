#include "rgbd/normals.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "base/error.hpp"
#include "support/analytic_scene.hpp"
#include "support/plain_normals.hpp"

namespace weft::rgbd {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

bool missing(const cv::Vec3f& n) {
  return std::isnan(n[0]) && std::isnan(n[1]) && std::isnan(n[2]);
}

bool same_bits(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.isContinuous() && b.isContinuous() &&
         std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

/// A small camera, wrinkled cloth with raised squares on it.
test::AnalyticScene cloth(int width, int height) {
  test::AnalyticScene scene;
  scene.camera = {width, height, 260.0, 250.0, 0.5 * width - 3.2, 0.5 * height + 1.7};
  scene.distance_m = 0.55;
  scene.tilt_deg = 15;
  scene.holes = width * height / 1000;
  scene.missing_px = width * height / 100;
  scene.layers[0].height_m = [](double x, double y) { return 0.006 * std::sin(80 * x + 50 * y); };
  test::Layer raised;
  raised.height_m = [](double, double) { return 0.03; };
  raised.inside = [](double x, double y) {
    return std::abs(x) < 0.03 && std::abs(y - 0.02) < 0.04;
  };
  scene.layers.push_back(raised);
  return scene;
}

TEST(Normals, AreThoseOfTheDefinition) {
  const auto view = test::render(cloth(150, 110));
  NormalOptions wide;
  wide.radius_m = 0.02;
  wide.depth_gate_m = 0.015;
  wide.min_share = 0.6;
  NormalOptions least;  // the least window, and a greatest one that is bounded
  least.radius_m = 0.001;
  NormalOptions greatest;
  greatest.radius_m = 0.1;
  greatest.max_radius_px = 15;
  for (const auto& options : {NormalOptions{}, wide, least, greatest}) {
    const cv::Mat normals = estimate_normals(view.surface, options, 1);
    EXPECT_GT(test::expect_plain_normals(normals, view.surface, options, {0, 0, 150, 110}, 3),
              1000);
  }
}

TEST(Normals, AreUnitVectorsThatFaceTheCamera) {
  const auto view = test::render(cloth(150, 110));
  const cv::Mat normals = estimate_normals(view.surface, {}, 1);
  for (int i = 0; i < 150 * 110; ++i) {
    const auto& n = normals.ptr<cv::Vec3f>()[i];
    const auto& p = view.surface.points_m.ptr<cv::Vec3f>()[i];
    if (missing(p)) {
      EXPECT_TRUE(missing(n));
    }
    if (missing(n)) continue;
    EXPECT_NEAR(n.dot(n), 1.0, 1e-6);
    EXPECT_LT(n.dot(p), 0.0);
  }
}

TEST(Normals, OfAPlaneAreExactUpToItsHolesAndEdges) {
  // Squares raised by 3 cm: further apart than the gate, so that neither bleeds into the other.
  for (const double tilt_deg : {0.0, 20.0, -35.0}) {
    auto scene = cloth(160, 120);
    scene.tilt_deg = tilt_deg;
    scene.noise_px = scene.step_px = scene.stray_px = 0.0;
    scene.layers[0] = {};
    const auto view = test::render(scene);
    const cv::Mat normals = estimate_normals(view.surface, {}, 1);
    int valid = 0, defined = 0;
    for (int i = 0; i < 160 * 120; ++i) {
      if (missing(view.surface.points_m.ptr<cv::Vec3f>()[i])) continue;
      ++valid;
      const auto& n = normals.ptr<cv::Vec3f>()[i];
      if (missing(n)) continue;
      ++defined;
      ASSERT_NEAR(cv::norm(n - view.normals.ptr<cv::Vec3f>()[i]), 0.0, 2e-3) << i;
    }
    EXPECT_GT(defined, valid * 0.995);
  }
}

TEST(Normals, HaveTheSameBitsOnEveryPathAndThreadCount) {
  const auto view = test::render(cloth(163, 90));
  NormalOptions options;
  options.radius_m = 0.015;
  const cv::Mat baseline = estimate_normals(view.surface, options, 1, {}, SimdPath::kBaseline);
  for (const int threads : {2, 3}) {
    EXPECT_TRUE(same_bits(
        baseline, estimate_normals(view.surface, options, threads, {}, SimdPath::kBaseline)));
  }
  if (!simd_path_available(SimdPath::kAvx2)) GTEST_SKIP() << "AVX2: this processor has none";
  for (const int threads : {1, 2, 3}) {
    EXPECT_TRUE(
        same_bits(baseline, estimate_normals(view.surface, options, threads, {}, SimdPath::kAvx2)));
  }
}

TEST(Normals, AreTheSameWhereOnlySomeAreNeeded) {
  const auto view = test::render(cloth(163, 90));
  cv::Mat where = cv::Mat::zeros(90, 163, CV_8UC1);
  where(cv::Rect(40, 20, 30, 30)).setTo(255);
  where.at<std::uint8_t>(89, 162) = 1;
  const cv::Mat all = estimate_normals(view.surface, {}, 1);
  const cv::Mat some = estimate_normals(view.surface, {}, 2, where);
  int left_out = 0;
  for (int i = 0; i < 163 * 90; ++i) {
    const auto &a = all.ptr<cv::Vec3f>()[i], &b = some.ptr<cv::Vec3f>()[i];
    if (where.ptr()[i] != 0) {
      EXPECT_EQ(std::memcmp(&a, &b, sizeof a), 0);
    } else if (!missing(a) && missing(b)) {
      ++left_out;
    }
  }
  EXPECT_GT(left_out, 8000);
}

Surface flat(int width, int height, float z_m) {
  Surface surface;
  surface.camera = {width, height, 525.0, 525.0, 0.5 * width, 0.5 * height};
  surface.points_m = cv::Mat(height, width, CV_32FC3);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      const auto p = surface.camera.unproject(u, v, z_m);
      surface.points_m.at<cv::Vec3f>(v, u) = {static_cast<float>(p.x()), static_cast<float>(p.y()),
                                              z_m};
    }
  return surface;
}

TEST(Normals, AreMissingWhereNothingCanBeFitted) {
  const auto defined = [](const Surface& surface) {
    int count = 0;
    const cv::Mat normals = estimate_normals(surface, {}, 2);
    for (int i = 0; i < normals.rows * normals.cols; ++i)
      count += missing(normals.ptr<cv::Vec3f>()[i]) ? 0 : 1;
    return count;
  };
  EXPECT_EQ(defined(flat(1, 1, 1.0F)), 0);
  EXPECT_EQ(defined(flat(50, 1, 1.0F)), 0);
  EXPECT_EQ(defined(flat(2, 50, 1.0F)), 0);
  EXPECT_EQ(defined(flat(20, 20, 1.0F)), 400);
  for (const float nothing :
       {kNan, std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(), 0.0F,
        -1.0F, 1e-30F, 1e30F}) {
    EXPECT_EQ(defined(flat(40, 30, nothing)), 0) << nothing;
    // Columns of it leave lines and pairs of columns: no plane.
    Surface lines = flat(40, 30, 1.0F);
    for (int v = 0; v < 30; ++v)
      for (int u = 0; u < 40; ++u)
        if (u % 20 > 1) lines.points_m.at<cv::Vec3f>(v, u)[2] = nothing;
    EXPECT_EQ(defined(lines), 0) << nothing;
  }
}

TEST(Normals, RefuseWhatDoesNotFit) {
  Surface surface = flat(20, 10, 1.0F);
  EXPECT_THROW(estimate_normals(surface, {}, 1, cv::Mat::zeros(10, 19, CV_8UC1)), Error);
  NormalOptions options;
  options.max_radius_px = 16;
  EXPECT_THROW(estimate_normals(surface, options, 1), Error);
  surface.camera.width = 21;
  EXPECT_THROW(estimate_normals(surface, {}, 1), Error);
  surface.camera = {};
  EXPECT_THROW(estimate_normals(surface, {}, 1), Error);
  EXPECT_THROW(estimate_normals({}, {}, 1), Error);
}

}  // namespace
}  // namespace weft::rgbd
