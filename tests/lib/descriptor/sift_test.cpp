#include "descriptor/sift.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "rgbd/pcd_io.hpp"
#include "support/files.hpp"
#ifdef WEFT_HAVE_VLFEAT
extern "C" {
#include <vl/dsift.h>
#include <vl/imopv.h>
}
#endif

namespace weft::descriptor {
namespace {

// Wrinkles, edges and noise: smooth waves of several wavelengths plus a pattern of stripes.
cv::Mat cloth(int width, int height, std::uint64_t seed) {
  Random random(seed);
  cv::Mat image(height, width, CV_8UC3);
  struct Wave {
    double fx, fy, phase, size;
  };
  std::vector<Wave> waves;
  for (int i = 0; i < 12; ++i) {
    waves.push_back({random.uniform(-0.35, 0.35), random.uniform(-0.35, 0.35),
                     random.uniform(0, 6.28), random.uniform(4, 25)});
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double value = 128 + 1.5 * random.normal();
      for (const auto& wave : waves)
        value += wave.size * std::sin(wave.fx * x + wave.fy * y + wave.phase);
      if (x > width / 2 && (x + 2 * y) % 37 < 12) value -= 50;
      for (int c = 0; c < 3; ++c) {
        image.at<cv::Vec3b>(y, x)[c] =
            static_cast<std::uint8_t>(std::clamp(value + 7 * c, 0.0, 255.0));
      }
    }
  }
  return image;
}

std::vector<std::vector<double>> grey_of(const cv::Mat& image) {
  std::vector<std::vector<double>> grey(static_cast<std::size_t>(image.rows));
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const auto p = image.at<cv::Vec3b>(y, x);
      grey[static_cast<std::size_t>(y)].push_back(
          std::floor((29 * p[0] + 150 * p[1] + 77 * p[2]) / 256.0 + 0.5));
    }
  }
  return grey;
}

// Straight from the definition: a loop over all samples for each bin, libm, double precision.
std::vector<double> brute_force(const std::vector<std::vector<double>>& grey, int px, int py,
                                const SiftOptions& options, double& contrast) {
  const int height = static_cast<int>(grey.size()), width = static_cast<int>(grey[0].size());
  const auto at = [&](int x, int y) {
    return grey[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)];
  };
  const int b = options.bin_px;
  std::vector<double> histogram(128, 0.0);
  const double mid_x = px + (b % 2 ? 0.5 : 0.0), mid_y = py + (b % 2 ? 0.5 : 0.0);
  for (int bin_y = 0; bin_y < 4; ++bin_y) {
    for (int bin_x = 0; bin_x < 4; ++bin_x) {
      const double centre_x = mid_x + b * (bin_x - 1.5), centre_y = mid_y + b * (bin_y - 1.5);
      for (int dy = -b + 1; dy < b; ++dy) {
        for (int dx = -b + 1; dx < b; ++dx) {
          const int x = std::clamp(static_cast<int>(centre_x) + dx, 0, width - 1);
          const int y = std::clamp(static_cast<int>(std::floor(centre_y)) + dy, 0, height - 1);
          const double gx = (at(std::min(x + 1, width - 1), y) - at(std::max(x - 1, 0), y)) *
                            (x > 0 && x < width - 1 ? 0.5 : 1.0);
          const double gy = (at(x, std::min(y + 1, height - 1)) - at(x, std::max(y - 1, 0))) *
                            (y > 0 && y < height - 1 ? 0.5 : 1.0);
          double angle = std::atan2(gy, gx) * 4.0 / M_PI;
          if (angle < 0) angle += 8.0;
          const int low = static_cast<int>(angle) % 8;
          const double share = angle - std::floor(angle);
          const auto window = [&](double at_x, double at_y) {
            const double s = b * options.window_size_bins;
            return std::exp(-0.5 *
                            (std::pow((at_x - mid_x) / s, 2) + std::pow((at_y - mid_y) / s, 2)));
          };
          double weight = (1 - std::abs(dx) / double(b)) * (1 - std::abs(dy) / double(b));
          if (options.window == SiftOptions::Window::kGaussian) {
            weight *= window(centre_x + dx, centre_y + dy);
          } else {
            double mean = 0;
            for (int v = -b + 1; v < b; ++v) {
              for (int u = -b + 1; u < b; ++u) mean += window(centre_x + u, centre_y + v);
            }
            weight *= mean / ((2 * b - 1) * (2 * b - 1));
          }
          const std::size_t base = static_cast<std::size_t>(8 * (bin_x + 4 * bin_y));
          histogram[base + static_cast<std::size_t>(low)] +=
              weight * std::hypot(gx, gy) * (1 - share);
          histogram[base + static_cast<std::size_t>((low + 1) % 8)] +=
              weight * std::hypot(gx, gy) * share;
        }
      }
    }
  }
  double mass = 0;
  for (const double v : histogram) mass += v;
  contrast = mass / 255.0 / ((3 * b + 1) * (3 * b + 1));
  const auto normalise = [&] {
    double squares = 0;
    for (const double v : histogram) squares += v * v;
    for (double& v : histogram) v /= std::sqrt(squares);
  };
  normalise();
  for (double& v : histogram) v = std::min(v, 0.2);
  normalise();
  for (double& v : histogram) v = std::min(255.0, 512.0 * v);
  return histogram;
}

SiftOptions options_with(int bin_px, SiftOptions::Window window, bool presmooth) {
  SiftOptions options;
  options.bin_px = bin_px;
  options.window = window;
  options.presmooth = presmooth;
  options.contrast_threshold = 0.0;
  return options;
}

TEST(Sift, AgreesWithTheDefinition) {
  const cv::Mat image = cloth(61, 47, 3);
  const auto grey = grey_of(image);
  const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  for (const auto window : {SiftOptions::Window::kFlat, SiftOptions::Window::kGaussian}) {
    for (const int b : {2, 3, 4, 5}) {
      const auto options = options_with(b, window, false);
      const Grid grid = make_grid(image.cols, image.rows, {7, 0});  // patches overhang the image
      const auto field = SiftDescriptor(options).describe_image(image, mask, grid, 2);
      ASSERT_EQ(field.points.size(), grid.cells());
      for (std::size_t i = 0; i < field.points.size(); ++i) {
        double contrast;
        const auto expected =
            brute_force(grey, grid.x(static_cast<int>(i) % grid.columns),
                        grid.y(static_cast<int>(i) / grid.columns), options, contrast);
        for (std::size_t k = 0; k < 128; ++k) {
          // Half a unit of rounding, and the arc tangent's 1e-5 of a vote.
          ASSERT_NEAR(field.values[i * 128 + k], expected[k], 0.52)
              << "bin " << b << " point " << i << " value " << k;
        }
      }
    }
  }
}

TEST(Sift, ContrastThresholdIsTheMeanWeightedGradient) {
  const cv::Mat image = cloth(61, 47, 5);
  const auto grey = grey_of(image);
  const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  auto options = options_with(4, SiftOptions::Window::kFlat, false);
  const Grid grid = make_grid(image.cols, image.rows, {});
  std::vector<double> contrasts(grid.cells());
  for (std::size_t i = 0; i < contrasts.size(); ++i) {
    brute_force(grey, grid.x(static_cast<int>(i) % grid.columns),
                grid.y(static_cast<int>(i) / grid.columns), options, contrasts[i]);
  }
  auto sorted = contrasts;
  std::sort(sorted.begin(), sorted.end());
  options.contrast_threshold = (sorted[sorted.size() / 2] + sorted[sorted.size() / 2 - 1]) / 2;
  const auto field = SiftDescriptor(options).describe_image(image, mask, grid, 1);
  for (std::size_t i = 0; i < contrasts.size(); ++i) {
    EXPECT_EQ(field.state[i] == PointState::kDescribed, contrasts[i] > options.contrast_threshold);
  }
}

TEST(Sift, FlatGreyHasNoWord) {
  const cv::Mat image(64, 64, CV_8UC3, cv::Scalar(90, 90, 90));
  const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  SiftOptions options;
  for (const double threshold : {0.0, 0.001}) {
    options.contrast_threshold = threshold;
    const auto field =
        SiftDescriptor(options).describe_image(image, mask, make_grid(64, 64, {}), 1);
    EXPECT_TRUE(field.points.empty());
    for (const auto state : field.state) EXPECT_EQ(state, PointState::kNothing);
  }
}

TEST(Sift, DescribesOnlyInsideTheMaskAndTheSameAsWithoutOne) {
  const cv::Mat image = cloth(160, 120, 9);
  const Grid grid = make_grid(image.cols, image.rows, {});
  for (const bool presmooth : {false, true}) {
    for (const int b : {3, 4}) {
      const SiftDescriptor sift(options_with(b, SiftOptions::Window::kFlat, presmooth));
      const auto all =
          sift.describe_image(image, cv::Mat(image.size(), CV_8UC1, cv::Scalar(255)), grid, 1);
      cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0));
      for (int y = 40; y < 90; ++y) {
        for (int x = 50 + y / 5; x < 110; ++x) mask.at<std::uint8_t>(y, x) = 255;
      }
      mask.at<std::uint8_t>(6, 6) = 1;
      const auto some = sift.describe_image(image, mask, grid, 3);
      std::size_t found = 0;
      for (std::size_t cell = 0; cell < grid.cells(); ++cell) {
        const int x = grid.x(static_cast<int>(cell) % grid.columns);
        const int y = grid.y(static_cast<int>(cell) / grid.columns);
        ASSERT_EQ(some.state[cell] == PointState::kDescribed, mask.at<std::uint8_t>(y, x) != 0);
        if (some.state[cell] != PointState::kDescribed) continue;
        ASSERT_EQ(some.points[found], static_cast<std::int32_t>(cell));
        EXPECT_TRUE(std::equal(some.values.begin() + static_cast<std::ptrdiff_t>(found * 128),
                               some.values.begin() + static_cast<std::ptrdiff_t>(found * 128 + 128),
                               all.values.begin() + static_cast<std::ptrdiff_t>(cell * 128)));
        ++found;
      }
      EXPECT_GT(found, 30u);
      EXPECT_EQ(found, some.points.size());
    }
  }
}

TEST(Sift, SameBitsOnEveryPathAndThreadCount) {
  if (!simd_path_available(SimdPath::kAvx2)) GTEST_SKIP() << "AVX2: this processor has none";
  for (const int size : {33, 131, 200}) {
    const cv::Mat image = cloth(size, size - 20, static_cast<std::uint64_t>(size));
    const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
    const Grid grid = make_grid(image.cols, image.rows, {5, 3});
    for (const auto window : {SiftOptions::Window::kFlat, SiftOptions::Window::kGaussian}) {
      for (const int b : {3, 4, 7}) {
        const auto options = options_with(b, window, b != 4);
        const auto baseline =
            SiftDescriptor(options, SimdPath::kBaseline).describe_image(image, mask, grid, 1);
        const auto avx2 =
            SiftDescriptor(options, SimdPath::kAvx2).describe_image(image, mask, grid, 5);
        ASSERT_EQ(baseline.points, avx2.points);
        ASSERT_EQ(baseline.values, avx2.values);
      }
    }
  }
}

TEST(Sift, RefusesImagesThatDoNotFit) {
  const SiftDescriptor sift{SiftOptions{}};
  const cv::Mat image(40, 50, CV_8UC3, cv::Scalar(0, 0, 0));
  const cv::Mat mask(40, 50, CV_8UC1, cv::Scalar(255));
  EXPECT_THROW(sift.describe_image(cv::Mat(), mask, {}, 1), Error);
  EXPECT_THROW(sift.describe_image(image, mask.rowRange(0, 20), {}, 1), Error);
  EXPECT_THROW(sift.describe_image(image, mask, make_grid(80, 40, {}), 1), Error);
  rgbd::View view;
  view.width = 20;
  view.height = 20;
  EXPECT_THROW(sift.describe({}, view, {image, mask}, make_grid(20, 20, {}), 1), Error);
}

#ifdef WEFT_HAVE_VLFEAT
// VLFeat, the peer: mean over the described points of |ours - theirs| / |theirs|.
void expect_vlfeat(const cv::Mat& image, double contrast_threshold) {
  const int width = image.cols, height = image.rows;
  std::vector<float> input;
  for (const auto& row : grey_of(image)) {
    for (const double v : row) input.push_back(static_cast<float>(v / 255.0));
  }
  const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  for (const bool presmooth : {false, true}) {
    for (const auto window : {SiftOptions::Window::kFlat, SiftOptions::Window::kGaussian}) {
      for (const int b : {3, 4, 5}) {
        auto smoothed = input;
        if (presmooth) {
          vl_imsmooth_f(smoothed.data(), static_cast<vl_size>(width), input.data(),
                        static_cast<vl_size>(width), static_cast<vl_size>(height),
                        static_cast<vl_size>(width), std::sqrt(b * b / 9.0 - 0.25),
                        std::sqrt(b * b / 9.0 - 0.25));
        }
        VlDsiftFilter* filter = vl_dsift_new_basic(width, height, 6, b);
        vl_dsift_set_flat_window(filter, window == SiftOptions::Window::kFlat);
        vl_dsift_process(filter, smoothed.data());
        // Our frames stand on whole pixels, theirs half a pixel further when b is odd.
        const Grid grid{3 * b / 2, 3 * b / 2, 6, (width - 1 - 3 * b) / 6 + 1,
                        (height - 1 - 3 * b) / 6 + 1};
        auto options = options_with(b, window, presmooth);
        options.contrast_threshold = contrast_threshold;
        const auto field = SiftDescriptor(options).describe_image(image, mask, grid, 1);
        ASSERT_EQ(static_cast<int>(grid.cells()), vl_dsift_get_keypoint_num(filter));
        ASSERT_GT(field.points.size(), grid.cells() / 2);
        ASSERT_EQ(vl_dsift_get_keypoints(filter)[1].x, 1.5 * b + 6);
        const float* theirs = vl_dsift_get_descriptors(filter);
        double total = 0, worst = 0;
        for (std::size_t i = 0; i < field.points.size(); ++i) {
          const auto cell = static_cast<std::size_t>(field.points[i]);
          double difference = 0, norm = 0;
          for (std::size_t k = 0; k < 128; ++k) {
            const double expected =
                std::min(255.0, 512.0 * static_cast<double>(theirs[cell * 128 + k]));
            difference += std::pow(field.values[i * 128 + k] - expected, 2);
            norm += expected * expected;
          }
          total += std::sqrt(difference / norm);
          worst = std::max(worst, std::sqrt(difference / norm));
        }
        const double mean = total / static_cast<double>(field.points.size());
        std::printf("bin %d %s%s: mean difference %.3f %%, worst %.3f %%\n", b,
                    window == SiftOptions::Window::kFlat ? "flat" : "gaussian",
                    presmooth ? ", smoothed" : "", 100 * mean, 100 * worst);
        EXPECT_LE(mean, 0.01);
        vl_dsift_delete(filter);
      }
    }
  }
}
#endif

TEST(Sift, AgreesWithVlfeatWithinOnePercent) {
#ifndef WEFT_HAVE_VLFEAT
  GTEST_SKIP() << "VLFeat: libvlfeat-dev is not installed";
#else
  expect_vlfeat(cloth(320, 240, 11), 0.0);
#endif
}

TEST(Sift, AgreesWithVlfeatOnRealScans) {
#ifndef WEFT_HAVE_VLFEAT
  GTEST_SKIP() << "VLFeat: libvlfeat-dev is not installed";
#else
  for (const char* name :
       {"pcl-scans/office1.pcd", "uc3m-garments/pcd/20150902_towel02_2_fold.pcd"}) {
    const auto path = (test::data_folder() / name).string();
    WEFT_NEEDS_DATA(path);
    const auto colour = rgbd::read_pcd(path).colour;
    ASSERT_FALSE(colour.empty()) << name;
    // What has less contrast has no word.
    expect_vlfeat(colour(cv::Rect(200, 120, 240, 180)).clone(), SiftOptions().contrast_threshold);
  }
#endif
}

}  // namespace
}  // namespace weft::descriptor
