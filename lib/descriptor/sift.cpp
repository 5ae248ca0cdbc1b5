#include "descriptor/sift.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"
#include "descriptor/sift_kernel.hpp"

namespace weft::descriptor {
namespace {

constexpr int kBins = 4;

const SiftKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (path == SimdPath::kAvx2) return kSiftAvx2;
#endif
  return kSiftBaseline;
}

// Weights of the samples -(b-1) ... b-1 px from each bin's centre along one axis.
using BinWeights = std::array<std::vector<float>, kBins>;

BinWeights bin_weights(const SiftOptions& options) {
  const int b = options.bin_px;
  const double sigma = b * options.window_size_bins;
  BinWeights weights;
  for (int bin = 0; bin < kBins; ++bin) {
    const double from_centre = b * (bin - 1.5);
    const auto gauss = [&](int x) {
      const double z = (x + from_centre) / sigma;
      return det::exp(-0.5 * z * z);
    };
    double mean = 0.0;
    for (int x = -b + 1; x < b; ++x) mean += gauss(x) / (2 * b - 1);
    for (int x = -b + 1; x < b; ++x) {
      const double triangle = 1.0 - static_cast<double>(std::abs(x)) / b;
      const double weight = options.window == SiftOptions::Window::kFlat ? mean : gauss(x);
      weights[static_cast<std::size_t>(bin)].push_back(static_cast<float>(triangle * weight));
    }
  }
  return weights;
}

std::vector<float> gaussian_weights(double sigma) {
  const int radius = static_cast<int>(std::ceil(4.0 * sigma));
  std::vector<double> weights;
  double total = 0.0;
  for (int x = -radius; x <= radius; ++x) {
    weights.push_back(det::exp(-0.5 * x * x / (sigma * sigma)));
    total += weights.back();
  }
  std::vector<float> out;
  for (const double weight : weights) out.push_back(static_cast<float>(weight / total));
  return out;
}

// Grey values 0 ... 255 of a part of the image.
struct Plane {
  int x = 0, y = 0, width = 0, height = 0;
  std::vector<float> values;
  float* row(int r) { return values.data() + static_cast<std::ptrdiff_t>(r) * width; }
  const float* row(int r) const { return values.data() + static_cast<std::ptrdiff_t>(r) * width; }
};

void grey_row(const cv::Mat& colour, int y, int x_begin, int width, float* out) {
  if (colour.channels() == 1) {
    const auto* in = colour.ptr<std::uint8_t>(y) + x_begin;
    for (int x = 0; x < width; ++x) out[x] = in[x];
    return;
  }
  const auto* in = colour.ptr<std::uint8_t>(y) + 3 * x_begin;
  // ITU-R BT.601 luma, rounded to an 8-bit grey level.
  for (int x = 0; x < width; ++x, in += 3)
    out[x] = static_cast<float>((29 * in[0] + 150 * in[1] + 77 * in[2] + 128) >> 8);
}

// The part [x0, x1) x [y0, y1) of the grey image, smoothed when weights are given; the image's edge
// repeats outward.
Plane grey_plane(const cv::Mat& colour, int x0, int y0, int x1, int y1,
                 const std::vector<float>& weights, const SiftKernel& kernel, int threads) {
  Plane out{x0, y0, x1 - x0, y1 - y0, {}};
  out.values.resize(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  if (weights.empty()) {
    for (int r = 0; r < out.height; ++r) grey_row(colour, y0 + r, x0, out.width, out.row(r));
    return out;
  }
  const int taps = static_cast<int>(weights.size());
  const int radius = taps / 2;
  parallel_for(out.height, threads, [&](int begin, int end) {
    // Columns first, on rows padded at the image's edge.
    const int first = std::max(0, y0 + begin - radius);
    const int last = std::min(colour.rows, y0 + end + radius);
    const int in_x0 = std::max(0, x0 - radius);
    const int in_x1 = std::min(colour.cols, x1 + radius);
    Plane across{x0, first, out.width, last - first, {}};
    across.values.resize(static_cast<std::size_t>(across.width) *
                         static_cast<std::size_t>(across.height));
    std::vector<float> padded(static_cast<std::size_t>(out.width + 2 * radius));
    for (int y = first; y < last; ++y) {
      float* inside = padded.data() + (in_x0 - (x0 - radius));
      grey_row(colour, y, in_x0, in_x1 - in_x0, inside);
      std::fill(padded.data(), inside, *inside);
      float* after = inside + (in_x1 - in_x0);
      std::fill(after, padded.data() + padded.size(), after[-1]);
      kernel.smooth_horizontal(padded.data(), weights.data(), taps, out.width,
                               across.row(y - first));
    }
    std::vector<const float*> rows(static_cast<std::size_t>(taps));
    for (int r = begin; r < end; ++r) {
      for (int tap = 0; tap < taps; ++tap) {
        const int y = std::clamp(y0 + r + tap - radius, 0, colour.rows - 1);
        rows[static_cast<std::size_t>(tap)] = across.row(y - first);
      }
      kernel.smooth_vertical(rows.data(), weights.data(), taps, out.width, out.row(r));
    }
  });
  return out;
}

// The described points of one grid row.
struct RowResult {
  std::vector<std::int32_t> points;
  std::vector<std::uint8_t> values;
};

}  // namespace

SiftDescriptor::SiftDescriptor(const SiftOptions& options, SimdPath path)
    : options_(options), path_(resolve_simd_path(path)) {
  options_.validate();
  if (!simd_path_available(path_)) throw Error("this processor has no AVX2; use the baseline path");
}

const std::string& SiftDescriptor::name() const {
  static const std::string name = "sift";
  return name;
}

DescriptorField SiftDescriptor::describe(const rgbd::RgbdFrame&, const rgbd::View& view,
                                         const rgbd::ViewImages& images, const Grid& grid,
                                         int threads) const {
  if (images.colour.cols != view.width || images.colour.rows != view.height)
    throw Error("dense SIFT: the colour image is not of the view's size; render the view first");
  return describe_image(images.colour, images.mask, grid, threads);
}

DescriptorField SiftDescriptor::describe_image(const cv::Mat& colour, const cv::Mat& mask,
                                               const Grid& grid, int threads) const {
  if (colour.empty() || colour.depth() != CV_8U ||
      (colour.channels() != 1 && colour.channels() != 3)) {
    throw Error("dense SIFT: expected an 8-bit image with 1 or 3 channels");
  }
  if (mask.type() != CV_8UC1 || mask.size() != colour.size())
    throw Error("dense SIFT: expected an 8-bit mask of the image's size");
  if (grid.columns < 0 || grid.rows < 0 || grid.step_px < 1 || grid.origin_x < 0 ||
      grid.origin_y < 0 || (grid.columns > 0 && grid.x(grid.columns - 1) >= colour.cols) ||
      (grid.rows > 0 && grid.y(grid.rows - 1) >= colour.rows)) {
    throw Error("dense SIFT: the grid reaches beyond the image; make it with make_grid()");
  }
  DescriptorField field;
  field.grid = grid;
  field.dimension = kDimension;
  field.state.assign(grid.cells(), PointState::kOutsideMask);

  std::vector<int> rows;  // grid rows with points inside the mask
  int first_column = grid.columns, last_column = -1;
  for (int row = 0; row < grid.rows; ++row) {
    const auto* mask_row = mask.ptr<std::uint8_t>(grid.y(row));
    bool any = false;
    for (int column = 0; column < grid.columns; ++column) {
      if (!mask_row[grid.x(column)]) continue;
      field.state[static_cast<std::size_t>(row * grid.columns + column)] = PointState::kNothing;
      first_column = std::min(first_column, column);
      last_column = std::max(last_column, column);
      any = true;
    }
    if (any) rows.push_back(row);
  }
  if (rows.empty()) return field;

  const SiftKernel& kernel = kernel_of(path_);
  const BinWeights weights = bin_weights(options_);
  const int b = options_.bin_px;
  const int taps = 2 * b - 1;
  // From a grid point to its first sample, and the number of samples along a side.
  const int to_first = -(3 * b / 2) - (b - 1);
  const int support = 3 * b + taps;
  const double variance = b * b / 9.0 - 0.25;
  const std::vector<float> smoothing = options_.presmooth && variance > 0.0
                                           ? gaussian_weights(std::sqrt(variance))
                                           : std::vector<float>{};

  // Samples, may lie outside the image; votes exist inside; gradients need one pixel more.
  const int x_begin = grid.x(first_column) + to_first;
  const int x_end = grid.x(last_column) + to_first + support;
  const int y_begin = grid.y(rows.front()) + to_first;
  const int y_end = grid.y(rows.back()) + to_first + support;
  const int vote_x0 = std::max(0, x_begin), vote_x1 = std::min(colour.cols, x_end);
  const int vote_y0 = std::max(0, y_begin), vote_y1 = std::min(colour.rows, y_end);
  const Plane plane = grey_plane(colour, std::max(0, vote_x0 - 1), std::max(0, vote_y0 - 1),
                                 std::min(colour.cols, vote_x1 + 1),
                                 std::min(colour.rows, vote_y1 + 1), smoothing, kernel, threads);

  const auto row_size = static_cast<std::size_t>(x_end - x_begin) * 8;
  const float to_contrast =
      1.0f / (255.0f * static_cast<float>(3 * b + 1) * static_cast<float>(3 * b + 1));
  const auto threshold = static_cast<float>(options_.contrast_threshold);
  std::vector<RowResult> results(rows.size());
  parallel_for(static_cast<int>(rows.size()), threads, [&](int begin, int end) {
    // Votes of the last `support` image rows, row y in slot y mod support.
    std::vector<float> ring(row_size * static_cast<std::size_t>(support));
    const auto slot = [&](int y) {
      return ring.data() + static_cast<std::size_t>(y % support) * row_size;
    };
    std::vector<float> scratch(static_cast<std::size_t>(3 * scratch_stride(plane.width)));
    std::vector<float> sums(row_size);
    std::vector<const float*> tap_rows(static_cast<std::size_t>(taps));
    std::vector<float> histograms(static_cast<std::size_t>(grid.columns) * kDimension);
    std::vector<int> columns;
    int next_y = 0;
    for (int index = begin; index < end; ++index) {
      const int row = rows[static_cast<std::size_t>(index)];
      const int first_y = grid.y(row) + to_first;
      next_y = std::max(next_y, std::max(first_y, vote_y0));
      for (; next_y < std::min(first_y + support, vote_y1); ++next_y) {
        const int r = next_y - plane.y;
        const int above = std::max(r - 1, 0), below = std::min(r + 1, plane.height - 1);
        float* votes = slot(next_y);
        float* inside = votes + 8 * (vote_x0 - x_begin);
        kernel.votes(plane.row(above), plane.row(r), plane.row(below),
                     below - above == 2 ? 0.5f : 1.0f, vote_x0 - plane.x, vote_x1 - plane.x,
                     plane.width, scratch.data(), inside);
        for (float* p = votes; p < inside; p += 8) std::copy_n(inside, 8, p);
        float* after = inside + 8 * (vote_x1 - vote_x0);
        for (float* p = after; p < votes + row_size; p += 8) std::copy_n(after - 8, 8, p);
      }
      columns.clear();
      for (int column = first_column; column <= last_column; ++column) {
        if (field.state[static_cast<std::size_t>(row * grid.columns + column)] ==
            PointState::kNothing) {
          columns.push_back(column);
        }
      }
      const int span_begin = grid.x(columns.front()) + to_first - x_begin;
      const int span_end = grid.x(columns.back()) + to_first + support - x_begin;
      for (int bin_y = 0; bin_y < kBins; ++bin_y) {
        for (int tap = 0; tap < taps; ++tap) {
          const int y = std::clamp(first_y + b * bin_y + tap, vote_y0, vote_y1 - 1);
          tap_rows[static_cast<std::size_t>(tap)] = slot(y) + 8 * span_begin;
        }
        kernel.vertical(tap_rows.data(), weights[static_cast<std::size_t>(bin_y)].data(), taps,
                        span_end - span_begin, sums.data());
        for (std::size_t i = 0; i < columns.size(); ++i) {
          const float* in =
              sums.data() + 8 * (grid.x(columns[i]) + to_first - x_begin - span_begin);
          float* out = histograms.data() + i * kDimension + static_cast<std::size_t>(bin_y) * 32;
          for (int bin_x = 0; bin_x < kBins; ++bin_x) {
            kernel.horizontal(in + 8 * b * bin_x, weights[static_cast<std::size_t>(bin_x)].data(),
                              taps, out + 8 * bin_x);
          }
        }
      }
      RowResult& result = results[static_cast<std::size_t>(index)];
      result.values.reserve(columns.size() * kDimension);
      for (std::size_t i = 0; i < columns.size(); ++i) {
        const float* histogram = histograms.data() + i * kDimension;
        const float mass = kernel.mass(histogram);
        if (!(mass > 0.0f) || mass * to_contrast < threshold) continue;
        result.points.push_back(row * grid.columns + columns[i]);
        result.values.resize(result.values.size() + kDimension);
        kernel.finish(histogram, result.values.data() + result.values.size() - kDimension);
      }
    }
  });
  std::size_t total = 0;
  for (const auto& result : results) total += result.points.size();
  field.points.reserve(total);
  field.values.reserve(total * kDimension);
  for (const auto& result : results) {
    field.points.insert(field.points.end(), result.points.begin(), result.points.end());
    field.values.insert(field.values.end(), result.values.begin(), result.values.end());
    for (const int point : result.points)
      field.state[static_cast<std::size_t>(point)] = PointState::kDescribed;
  }
  return field;
}

}  // namespace weft::descriptor
