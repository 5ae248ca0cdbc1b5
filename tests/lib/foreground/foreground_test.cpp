#include "foreground/foreground.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/table_scene.hpp"

namespace weft::foreground {
namespace {

using test::TableScene;

struct Case {
  const char* name;
  cv::Vec3d cloth;  // BGR
  cv::Vec3d (*table)(double, double);
  double thickness_m;
  double min_iou;
};

TEST(Foreground, FindsAShirtOnATable) {
  for (const Case& c : {Case{"blue on planks", {140, 80, 50}, test::planks, 0.004, 0.96},
                        Case{"grey on planks", {150, 150, 150}, test::planks, 0.004, 0.93},
                        Case{"near black on planks", {14, 13, 12}, test::planks, 0.004, 0.96},
                        Case{"red on white", {50, 40, 190}, test::white, 0.003, 0.96},
                        Case{"white on white", {203, 206, 206}, test::white, 0.010, 0.95},
                        Case{"white on white, thin", {203, 206, 206}, test::white, 0.005, 0.95}})
    for (const double tilt_deg : {0.0, 12.0}) {
      TableScene scene;
      scene.tilt_deg = tilt_deg;
      scene.colour = [&](double x, double y, bool cloth) {
        return cloth ? c.cloth : c.table(x, y);
      };
      scene.cloth_m = [&](double x, double y) { return test::shirt_m(x, y, c.thickness_m); };
      rgbd::RgbdFrame frame = scene.render();
      const cv::Mat truth = frame.mask;
      frame.mask = cv::Mat();
      const Foreground found = find_foreground(frame, {});
      EXPECT_GE(test::iou(found.mask, truth), c.min_iou) << c.name << ", " << tilt_deg << " deg";
      ASSERT_TRUE(found.table);
      EXPECT_NEAR(found.table->distance_m, scene.table().distance_m, 0.004);
      EXPECT_EQ(found.source, Foreground::Source::kLive);
    }
}

TEST(Foreground, FindsNearBlackClothThatReturnsNoDepth) {
  TableScene scene;
  scene.colour = [](double x, double y, bool cloth) {
    return cloth ? cv::Vec3d(12, 12, 12) : test::white(x, y);
  };
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  rgbd::RgbdFrame frame = scene.render();
  const cv::Mat truth = frame.mask;
  Random random(5);
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      if (truth.at<std::uint8_t>(v, u) && (v / 40 + u / 40) % 2)
        frame.depth.at<std::uint16_t>(v, u) = 0;
  EXPECT_GE(test::iou(find_foreground(frame, {}).mask, truth), 0.96);
}

TEST(Foreground, FindsAGarmentThatTouchesTheBorder) {
  TableScene scene;
  scene.colour = [](double x, double y, bool cloth) {
    return cloth ? cv::Vec3d(60, 120, 60) : test::planks(x, y);
  };
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x + 0.55, y - 0.1, 0.006); };
  const rgbd::RgbdFrame frame = scene.render();
  EXPECT_GT(cv::countNonZero(frame.mask.col(0)), 50);
  EXPECT_GE(test::iou(find_foreground(frame, {}).mask, frame.mask), 0.95);
}

TEST(Foreground, FindsBothOfTwoGarments) {
  TableScene scene;
  scene.colour = [](double x, double y, bool cloth) {
    return !cloth ? test::planks(x, y) : x < 0.0 ? cv::Vec3d(60, 50, 160) : cv::Vec3d(30, 30, 30);
  };
  scene.cloth_m = [](double x, double y) {
    return std::max(test::shirt_m(x + 0.32, y), test::shirt_m(x - 0.32, y));
  };
  const rgbd::RgbdFrame frame = scene.render();
  EXPECT_GE(test::iou(find_foreground(frame, {}).mask, frame.mask), 0.95);
}

TEST(Foreground, TellsTheTableFromTheFloorBesideIt) {
  // A table that fills the image but for a corner, and one that takes a quarter of it
  for (const double half_m : {0.55, 0.30})
    for (const double tilt_deg : {0.0, 12.0}) {
      TableScene scene;
      scene.tilt_deg = tilt_deg;
      scene.table_top = [&](double x, double y) {
        return std::abs(x + y) < half_m * 1.4 && std::abs(x - y) < half_m * 1.4;
      };
      scene.colour = [](double x, double y, bool cloth) {
        return cloth ? cv::Vec3d(140, 80, 50) : test::planks(x, y);
      };
      scene.cloth_m = [](double x, double y) {
        return std::abs(x) < 0.15 && std::abs(y) < 0.12 ? 0.006 : -1.0;
      };
      const rgbd::RgbdFrame frame = scene.render();
      const Foreground found = find_foreground(frame, {});
      ASSERT_TRUE(found.table);
      EXPECT_NEAR(found.table->distance_m, scene.table().distance_m, 0.004) << half_m;
      EXPECT_GE(test::iou(found.mask, frame.mask), 0.95) << half_m << " m, " << tilt_deg << " deg";
    }
}

TEST(Foreground, LeavesHolesThatShowTheTable) {
  TableScene scene;
  const auto hole = [](double x, double y) { return x * x + y * y < 0.06 * 0.06; };
  scene.colour = [](double x, double y, bool cloth) {
    return cloth ? cv::Vec3d(140, 80, 50) : test::white(x, y);
  };
  scene.cloth_m = [&](double x, double y) { return hole(x, y) ? -1.0 : test::shirt_m(x, y); };
  const rgbd::RgbdFrame frame = scene.render();
  EXPECT_GE(test::iou(find_foreground(frame, {}).mask, frame.mask), 0.95);
}

TEST(Foreground, FindsNothingOnAnEmptyTable) {
  for (auto* table : {test::planks, test::white})
    for (const double tilt_deg : {0.0, 10.0})
      for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        TableScene scene;
        scene.seed = seed;
        scene.tilt_deg = tilt_deg;
        // A stain and a shadow are as flat as the table.
        scene.colour = [&](double x, double y, bool) {
          cv::Vec3d c = table(x, y);
          if (x * x + y * y < 0.01) c *= 0.6;
          if (x > 0.3) c *= 0.75;
          return c;
        };
        const Foreground found = find_foreground(scene.render(), {});
        EXPECT_EQ(cv::countNonZero(found.mask), 0) << "seed " << seed << ", " << tilt_deg << " deg";
        EXPECT_TRUE(found.table);
      }
}

TEST(Foreground, StandsATurnedCanvas) {
  // Colour black and depth missing outside a rotated picture; the garment is near black too.
  TableScene scene;
  scene.colour = [](double x, double y, bool cloth) {
    return cloth ? cv::Vec3d(15, 14, 13) : test::planks(x, y);
  };
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  rgbd::RgbdFrame frame = scene.render();
  for (int v = 0; v < 480; ++v)
    for (int u = 0; u < 640; ++u)
      if (std::abs(u - 320) + std::abs(v - 240) > 330) {
        frame.depth.at<std::uint16_t>(v, u) = 0;
        frame.colour.at<cv::Vec3b>(v, u) = {0, 0, 0};
        frame.mask.at<std::uint8_t>(v, u) = 0;
      }
  EXPECT_GE(test::iou(find_foreground(frame, {}).mask, frame.mask), 0.95);
}

TEST(Foreground, WorksAtOtherSizes) {
  for (const auto& camera : {rgbd::CameraModel{320, 240, 262.0, 262.0, 159.5, 119.5},
                             rgbd::CameraModel{1280, 720, 1050.0, 1050.0, 639.5, 359.5},
                             rgbd::CameraModel{641, 479, 525.0, 525.0, 319.5, 239.5}}) {
    TableScene scene;
    scene.camera = camera;
    scene.colour = [](double x, double y, bool cloth) {
      return cloth ? cv::Vec3d(140, 80, 50) : test::planks(x, y);
    };
    scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
    const rgbd::RgbdFrame frame = scene.render();
    EXPECT_GE(test::iou(find_foreground(frame, {}).mask, frame.mask), 0.93) << camera.width;
  }
}

TEST(Foreground, HasAnEmptyMaskWithoutATable) {
  TableScene scene;
  scene.colour = [](double, double, bool) { return cv::Vec3d(100, 100, 100); };
  rgbd::RgbdFrame frame = scene.render();
  frame.depth = cv::Mat::zeros(480, 640, CV_16UC1);
  const Foreground found = find_foreground(frame, {});
  EXPECT_FALSE(found.table);
  EXPECT_EQ(cv::countNonZero(found.mask), 0);
  EXPECT_EQ(found.mask.size(), cv::Size(640, 480));
}

TEST(Foreground, TakesTheDataSetsMask) {
  TableScene scene;
  scene.colour = [](double x, double y, bool) { return test::planks(x, y); };
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  rgbd::RgbdFrame frame = scene.render();
  frame.mask.setTo(1, frame.mask);
  ForegroundOptions options;
  options.mode = Foreground::Source::kDataset;
  const Foreground found = find_foreground(frame, options);
  EXPECT_EQ(found.source, Foreground::Source::kDataset);
  EXPECT_EQ(cv::countNonZero(found.mask == 255), cv::countNonZero(frame.mask));
  EXPECT_EQ(test::iou(found.mask, frame.mask * 255), 1.0);
  ASSERT_TRUE(found.table);
  EXPECT_NEAR(found.table->distance_m, scene.table().distance_m, 0.004);
  frame.mask = cv::Mat();
  EXPECT_THROW(find_foreground(frame, options), Error);
}

}  // namespace
}  // namespace weft::foreground
