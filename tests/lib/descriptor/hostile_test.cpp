// Every descriptor, through what the processes call, on scans with which something is wrong. Run
// under valgrind and the sanitizers by `./weft test --slow`.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "all_kinds.hpp"
#include "base/error.hpp"
#include "base/random.hpp"
#include "rgbd/surface.hpp"

namespace weft::descriptor {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// A wrinkled cloth that fills a small image, 0.7 m away.
rgbd::RgbdFrame cloth(int width, int height) {
  rgbd::RgbdFrame frame;
  frame.camera = {width, height, 525.0, 525.0, 0.5 * width, 0.5 * height};
  frame.colour.create(height, width, CV_8UC3);
  frame.depth.create(height, width, CV_16UC1);
  frame.mask = cv::Mat(height, width, CV_8UC1, cv::Scalar(255));
  Random random(1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c)
        frame.colour.at<cv::Vec3b>(y, x)[c] = static_cast<std::uint8_t>(random.below(256));
      frame.depth.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(
          700.5 + 4.0 * std::sin(0.2 * x + 0.1 * y) * std::cos(0.15 * y));
    }
  }
  return frame;
}

rgbd::View view_of(const rgbd::RgbdFrame& frame, bool rectified) {
  rgbd::ViewOptions options;
  options.rectified = rectified;
  options.margin_m = 0.0;
  const rgbd::Plane table{-Eigen::Vector3d::UnitZ(), -0.71, 0.001, 1000};
  return rgbd::make_view(frame, frame.mask, &table, options);
}

struct Answer {
  DescriptorField field;
  rgbd::Surface surface;
};

/// Describes every fourth pixel inside the mask and checks what holds for every answer: a state for
/// each cell, values for each described point, no word where there is no depth.
Answer describe(const DenseDescriptor& descriptor, const rgbd::RgbdFrame& frame, bool rectified,
                int threads = 1) {
  const auto view = view_of(frame, rectified);
  const Grid grid = make_grid(view.width, view.height, {4, 0});
  Answer answer{
      descriptor.describe(frame, view, rgbd::render_view(frame, frame.mask, view), grid, threads),
      rgbd::render_surface(frame, view)};
  const auto& field = answer.field;
  EXPECT_EQ(field.state.size(), grid.cells());
  EXPECT_EQ(field.dimension, descriptor.dimension());
  EXPECT_EQ(field.values.size(),
            field.points.size() * static_cast<std::size_t>(descriptor.dimension()));
  std::vector<std::int32_t> described;
  for (std::size_t cell = 0; cell < field.state.size(); ++cell) {
    if (field.state[cell] != PointState::kDescribed) continue;
    described.push_back(static_cast<std::int32_t>(cell));
    const int column = static_cast<int>(cell) % grid.columns;
    const int row = static_cast<int>(cell) / grid.columns;
    const auto& point = answer.surface.points_m.at<cv::Vec3f>(grid.y(row), grid.x(column));
    // FINDDD is of the normals of a patch, whatever its middle.
    if (descriptor.uses_depth() && descriptor.name() != "finddd") {
      EXPECT_TRUE(std::isfinite(point[2])) << descriptor.name() << " at a hole";
    }
  }
  EXPECT_EQ(field.points, described);
  return answer;
}

class Hostile : public testing::TestWithParam<DescriptorOptions> {
 protected:
  std::unique_ptr<DenseDescriptor> descriptor_ = make_descriptor(GetParam());
};

TEST_P(Hostile, AScanFullOfHoles) {
  for (const bool rectified : {false, true}) {
    const auto whole = describe(*descriptor_, cloth(120, 90), rectified);
    ASSERT_GT(whole.field.points.size(), 100u);
    // Holes of all sizes: single pixels, stripes, and all but a few islands.
    for (const double share : {0.2, 0.6, 0.97}) {
      auto frame = cloth(120, 90);
      Random random(7);
      for (int y = 0; y < 90; ++y) {
        for (int x = 0; x < 120; ++x) {
          if (random.uniform() < share || (x / 9) % 5 == 2) frame.depth.at<std::uint16_t>(y, x) = 0;
        }
      }
      const auto answer = describe(*descriptor_, frame, rectified);
      EXPECT_EQ(answer.field.values, describe(*descriptor_, frame, rectified, 3).field.values);
      if (descriptor_->uses_colour()) {
        EXPECT_EQ(answer.field.values, whole.field.values);
      } else {
        EXPECT_LT(answer.field.points.size(), whole.field.points.size());
      }
      if (descriptor_->uses_depth() && share > 0.9) {
        EXPECT_TRUE(answer.field.points.empty());
      }
    }
  }
}

TEST_P(Hostile, AScanWithoutDepth) {
  for (const bool rectified : {false, true}) {
    auto frame = cloth(60, 50);
    frame.depth.setTo(0);
    const auto answer = describe(*descriptor_, frame, rectified);
    if (!descriptor_->uses_depth()) continue;
    EXPECT_TRUE(answer.field.points.empty());
    for (const auto state : answer.field.state) EXPECT_NE(state, PointState::kDescribed);
  }
}

TEST_P(Hostile, OnePixel) {
  for (const bool rectified : {false, true}) {
    for (const int size : {1, 2, 3}) {
      const auto answer = describe(*descriptor_, cloth(size, size), rectified, 2);
      if (descriptor_->uses_depth()) {
        EXPECT_TRUE(answer.field.points.empty());
      }
    }
  }
}

TEST_P(Hostile, InfiniteAndAbsurdDepth) {
  for (const bool rectified : {false, true}) {
    for (const double unit_m :
         {1e300, double{kInfinity}, std::numeric_limits<double>::quiet_NaN(), 1e35, 1e-300, -1.0}) {
      auto frame = cloth(60, 50);
      frame.depth_unit_m = unit_m;
      const auto answer = describe(*descriptor_, frame, rectified);
      // What is no point of space has no word.
      for (const auto cell : answer.field.points) {
        const int columns = answer.field.grid.columns;
        const auto& point = answer.surface.points_m.at<cv::Vec3f>(
            answer.field.grid.y(cell / columns), answer.field.grid.x(cell % columns));
        ASSERT_TRUE(descriptor_->uses_colour() || (std::isfinite(point[0]) && point[2] > 0.0f))
            << unit_m << " " << point;
      }
    }
    // Far away for a few pixels only: nothing worse than a hole.
    auto odd = cloth(120, 90), holes = cloth(120, 90);
    Random random(3);
    for (int i = 0; i < 200; ++i) {
      const cv::Point at(static_cast<int>(random.below(120)), static_cast<int>(random.below(90)));
      odd.depth.at<std::uint16_t>(at) = 65535;
      holes.depth.at<std::uint16_t>(at) = 0;
    }
    const auto answer = describe(*descriptor_, odd, rectified);
    EXPECT_EQ(answer.field.values, describe(*descriptor_, odd, rectified, 2).field.values);
    EXPECT_LE(answer.field.points.size(), answer.field.state.size());
  }
}

TEST_P(Hostile, AMaskOfFewPixels) {
  for (const bool rectified : {false, true}) {
    auto frame = cloth(80, 60);
    frame.mask.setTo(0);
    frame.mask.at<std::uint8_t>(0, 0) = 255;
    frame.mask.at<std::uint8_t>(59, 79) = 255;
    const auto answer = describe(*descriptor_, frame, rectified);
    EXPECT_LE(answer.field.points.size(), 2u);
  }
}

INSTANTIATE_TEST_SUITE_P(Every, Hostile, testing::ValuesIn(test::all_kinds()),
                         [](const auto& kind) { return make_descriptor(kind.param)->name(); });

}  // namespace
}  // namespace weft::descriptor
