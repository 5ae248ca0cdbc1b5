#include "dataset/augment.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::dataset {
namespace {

using test::error_of;

Scene make_scene(int width = 40, int height = 30) {
  Random random(1);
  Scene scene;
  scene.name = "7";
  rgbd::RgbdFrame& frame = scene.frame;
  frame.camera = {width, height, 50.0, 50.0, 18.0, 16.0};
  frame.colour.create(height, width, CV_8UC3);
  frame.depth.create(height, width, CV_16UC1);
  frame.mask.create(height, width, CV_8UC1);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const auto shade = static_cast<std::uint8_t>(3 * u + 2 * v);
      frame.colour.at<cv::Vec3b>(v, u) = {shade, static_cast<std::uint8_t>(random.below(256)), 9};
      frame.depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(random.integer(500, 900));
      frame.mask.at<std::uint8_t>(v, u) = random.below(2) ? 255 : 0;
    }
  }
  scene.outline = {{3.0f, 4.0f}, {30.0f, 5.0f}, {20.0f, 25.0f}};
  PartPolygon part;
  part.part = "polo collar";
  part.points = {{10.0f, 10.0f}, {20.0f, 10.0f}, {15.0f, 20.0f}};
  scene.polygons = {part};
  return scene;
}

void expect_same(const cv::Mat& a, const cv::Mat& b) {
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(a.type(), b.type());
  for (int v = 0; v < a.rows; ++v)
    ASSERT_EQ(0, std::memcmp(a.ptr(v), b.ptr(v), static_cast<std::size_t>(a.cols) * a.elemSize()))
        << "row " << v;
}

TEST(Augment, QuarterTurnsAndMirrorsOnlyMovePixels) {
  const Scene scene = make_scene();
  const int codes[] = {-1, cv::ROTATE_90_CLOCKWISE, cv::ROTATE_180, cv::ROTATE_90_COUNTERCLOCKWISE};
  for (const bool mirror : {false, true}) {
    for (int quarter = 0; quarter < 4; ++quarter) {
      const Scene turned = augment(scene, {90.0 * quarter, mirror});
      const auto oracle = [&](cv::Mat image) {
        image = image.clone();
        if (mirror) cv::flip(image, image, 1);
        if (quarter > 0) cv::rotate(image, image, codes[quarter]);
        return image;
      };
      expect_same(turned.frame.colour, oracle(scene.frame.colour));
      expect_same(turned.frame.depth, oracle(scene.frame.depth));
      expect_same(turned.frame.mask, oracle(scene.frame.mask));
      EXPECT_EQ(turned.frame.camera.width, turned.frame.colour.cols);
      EXPECT_EQ(turned.frame.camera.height, turned.frame.colour.rows);
      // The polygon's corner still lies on the pixel it lay on.
      const cv::Point2f corner = turned.polygons[0].points[2];
      EXPECT_EQ(turned.frame.depth.at<std::uint16_t>(static_cast<int>(std::lround(corner.y)),
                                                     static_cast<int>(std::lround(corner.x))),
                scene.frame.depth.at<std::uint16_t>(20, 15));
    }
  }
}

TEST(Augment, ACameraRolledAboutItsAxisSeesTheSamePoints) {
  Scene scene = make_scene();
  for (const double fy : {50.0, 60.0}) {
    scene.frame.camera.fy = fy;
    for (const double angle : {45.0, 30.0, 90.0, 200.0, -17.5}) {
      for (const bool mirror : {false, true}) {
        const Scene turned = augment(scene, {angle, mirror});
        const double a = angle * M_PI / 180.0;
        for (std::size_t i = 0; i < scene.outline.size(); ++i) {
          const cv::Point2f from = scene.outline[i], to = turned.outline[i];
          const auto p = scene.frame.camera.unproject(from.x, from.y, 0.8);
          const double x = mirror ? -p.x() : p.x();
          const auto q = turned.frame.camera.project(Eigen::Vector3d(
              std::cos(a) * x - std::sin(a) * p.y(), std::sin(a) * x + std::cos(a) * p.y(), 0.8));
          EXPECT_NEAR(q.x(), to.x, 1e-4) << angle << " " << mirror;
          EXPECT_NEAR(q.y(), to.y, 1e-4) << angle << " " << mirror;
          EXPECT_GE(to.x, -0.5);
          EXPECT_LE(to.x, turned.frame.camera.width - 0.5);
          EXPECT_GE(to.y, -0.5);
          EXPECT_LE(to.y, turned.frame.camera.height - 0.5);
        }
      }
    }
  }
}

TEST(Augment, TheCanvasHoldsEverythingAndIsNoLarger) {
  Scene scene = make_scene(640, 480);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      scene.frame.depth.at<std::uint16_t>(v, u) =
          static_cast<std::uint16_t>(1 + u + 640 * (v % 60));
  const Scene turned = augment(scene, {45.0, true});
  EXPECT_EQ(turned.frame.camera.width, 792);  // (640 + 480) / sqrt(2) = 791.96
  EXPECT_EQ(turned.frame.camera.height, 792);
  int seen = cv::countNonZero(turned.frame.depth);
  EXPECT_NEAR(seen, 640 * 480, 1500);
  EXPECT_EQ(turned.frame.depth.at<std::uint16_t>(0, 0), 0);
}

TEST(Augment, NamesSayWhatWasDone) {
  for (const auto& [name, angle, mirror] : {std::tuple{"00023", 0.0, false},
                                            {"00023@r45m", 45.0, true},
                                            {"00023@r22.5", 22.5, false},
                                            {"a@b@r0m", 0.0, true}}) {
    const auto [base, augmentation] = parse_augmented_name(name);
    EXPECT_EQ(augmentation.angle_deg, angle);
    EXPECT_EQ(augmentation.mirror, mirror);
    EXPECT_EQ(base + augmentation.suffix(), name);
  }
  for (const char* bad : {"x@r", "x@rm", "x@r4x", "x@rnan", "x@r1e9", "x@r45mm"})
    EXPECT_NE(error_of([&] { parse_augmented_name(bad); }).find("rotation in degrees"),
              std::string::npos)
        << bad;
}

class TwoScenes : public Dataset {
 public:
  const std::vector<std::string>& names() const override { return names_; }
  Scene read(std::size_t index) const override {
    Scene scene = make_scene();
    scene.name = names_.at(index);
    return scene;
  }

 private:
  std::vector<std::string> names_ = {"7", "8"};
};

TEST(Augment, ASetShowsEachSceneInEveryView) {
  const auto set = augment(std::make_unique<TwoScenes>(), {.rotations = 8, .mirror = true});
  ASSERT_EQ(set->names().size(), 32u);
  EXPECT_EQ(set->names()[0], "7");
  EXPECT_EQ(set->names()[1], "7@r45");
  EXPECT_EQ(set->names()[8], "7@r0m");
  EXPECT_EQ(set->names()[31], "8@r315m");
  for (const std::size_t i : {0u, 3u, 9u, 31u}) {
    const Scene scene = set->read(i);
    EXPECT_EQ(scene.name, set->names()[i]);
    expect_same(scene.frame.colour, read_scene(TwoScenes(), set->names()[i]).frame.colour);
  }
  EXPECT_NE(error_of([&] { read_scene(*set, "9@r45"); }).find("no scene named 9"),
            std::string::npos);
}

}  // namespace
}  // namespace weft::dataset
