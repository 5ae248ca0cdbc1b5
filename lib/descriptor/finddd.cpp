#include "descriptor/finddd.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <type_traits>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"
#include "descriptor/finddd_kernel.hpp"

namespace weft::descriptor {
namespace {

using Direction = std::array<double, 3>;

const FindddKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (path == SimdPath::kAvx2) return kFindddAvx2;
#endif
  return kFindddBaseline;
}

double distance(const Direction& a, const Direction& b) {
  double squares = 0.0;
  for (std::size_t i = 0; i < 3; ++i) squares += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(squares);
}

/// Where the normals are that the patches of the cells hold. CV_8UC1.
cv::Mat pixels_of_patches(const Grid& grid, const std::vector<std::int32_t>& cells, int patch_px,
                          cv::Size size) {
  cv::Mat pixels = cv::Mat::zeros(size, CV_8UC1);
  for (auto first = cells.begin(); first != cells.end();) {
    const int row = *first / grid.columns;
    PatchSpan rows(grid.y(row), patch_px);
    rows.clip(size.height);
    cv::Mat line = cv::Mat::zeros(1, size.width, CV_8UC1);
    for (; first != cells.end() && *first / grid.columns == row; ++first) {
      PatchSpan columns(grid.x(*first % grid.columns), patch_px);
      columns.clip(size.width);
      line.colRange(columns.begin, columns.end) = 255;
    }
    for (int y = rows.begin; y < rows.end; ++y) cv::bitwise_or(pixels.row(y), line, pixels.row(y));
  }
  return pixels;
}

}  // namespace

std::vector<std::array<double, 3>> finddd_bins(int subdivisions) {
  std::vector<std::array<Direction, 3>> triangles;
  for (const double x : {-1.0, 1.0})
    for (const double y : {-1.0, 1.0})
      triangles.push_back({Direction{x, 0, 0}, Direction{0, y, 0}, Direction{0, 0, -1}});
  const auto middle = [](const Direction& a, const Direction& b) {
    const Direction sum{a[0] + b[0], a[1] + b[1], a[2] + b[2]};
    const double length = distance(sum, {0, 0, 0});
    return Direction{sum[0] / length, sum[1] / length, sum[2] / length};
  };
  for (int i = 0; i < subdivisions; ++i) {
    std::vector<std::array<Direction, 3>> finer;
    for (const auto& [a, b, c] : triangles) {
      const Direction ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    triangles = std::move(finer);
  }
  std::vector<Direction> bins;
  for (const auto& triangle : triangles) {
    for (const auto& corner : triangle) {
      if (std::none_of(bins.begin(), bins.end(),
                       [&](const Direction& bin) { return distance(bin, corner) < 1e-9; }))
        bins.push_back(corner);
    }
  }
  const auto azimuth = [](const Direction& d) {
    const double angle = det::atan2(d[1], d[0]);
    return angle < -1e-9 ? angle + 2.0 * 3.14159265358979323846 : angle;
  };
  std::sort(bins.begin(), bins.end(), [&](const Direction& a, const Direction& b) {
    if (std::abs(a[2] - b[2]) > 1e-9) return a[2] < b[2];
    return azimuth(a) < azimuth(b);
  });
  return bins;
}

FindddDescriptor::FindddDescriptor(const FindddOptions& options, SimdPath path)
    : options_(options),
      path_(resolve_simd_path(path)),
      radius_(std::numeric_limits<double>::infinity()) {
  options_.validate();
  if (!simd_path_available(path_)) throw Error("this processor has no AVX2; use the baseline path");
  bins_ = finddd_bins(options_.subdivisions);
  for (std::size_t i = 0; i < bins_.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) radius_ = std::min(radius_, distance(bins_[i], bins_[j]));
}

const std::string& FindddDescriptor::name() const {
  static const std::string name = "finddd";
  return name;
}

int FindddDescriptor::dimension() const {
  return options_.cells * options_.cells * static_cast<int>(bins_.size());
}

DescriptorField FindddDescriptor::describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                                           const rgbd::ViewImages& images, const Grid& grid,
                                           int threads) const {
  return describe_surface(rgbd::render_surface(frame, view), images.mask, grid,
                          patch_size_px(view, options_.patch_px, options_.patch_mm), threads);
}

DescriptorField FindddDescriptor::describe_surface(const rgbd::Surface& surface,
                                                   const cv::Mat& mask, const Grid& grid,
                                                   int patch_px, int threads) const {
  return run<DescriptorField>(surface, mask, grid, patch_px, threads);
}

FloatField FindddDescriptor::sums_of_surface(const rgbd::Surface& surface, const cv::Mat& mask,
                                             const Grid& grid, int patch_px, int threads) const {
  return run<FloatField>(surface, mask, grid, patch_px, threads);
}

template <class Field>
Field FindddDescriptor::run(const rgbd::Surface& surface, const cv::Mat& mask, const Grid& grid,
                            int patch_px, int threads) const {
  const auto points = masked_cells(surface, mask, grid, "FINDDD");
  if (patch_px < options_.cells || patch_px > 512) {
    throw Error("FINDDD: a patch of " + std::to_string(patch_px) + " px does not hold " +
                std::to_string(options_.cells) + " cells a side, or is larger than 512 px");
  }
  const cv::Size size = surface.points_m.size();
  const cv::Mat normals = rgbd::estimate_normals(
      surface, options_.normals, threads, pixels_of_patches(grid, points, patch_px, size), path_);

  // One lane a bin, and one that counts normals.
  const int bins = static_cast<int>(bins_.size());
  const int lanes = (bins + 16) & ~15;
  const auto padded = static_cast<std::size_t>(lanes);
  std::vector<float> x(padded), y(padded), z(padded), inverse_radius(padded, 1e6f);
  std::vector<std::int32_t> constant(padded);
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    x[i] = static_cast<float>(bins_[i][0]);
    y[i] = static_cast<float>(bins_[i][1]);
    z[i] = static_cast<float>(bins_[i][2]);
    inverse_radius[i] = static_cast<float>(1.0 / radius_);
  }
  constant[bins_.size()] = 1;
  const FindddLanes layout{bins,     lanes,    options_.soft_votes,   x.data(),
                           y.data(), z.data(), inverse_radius.data(), constant.data()};
  const FindddKernel& kernel = kernel_of(path_);

  const int cells = options_.cells;
  const auto sides = static_cast<std::size_t>(cells);
  std::vector<int> cuts;  // of the patch, from its first pixel
  int widest = 0;
  for (int k = 0; k <= cells; ++k) {
    cuts.push_back((2 * k * patch_px + cells) / (2 * cells));
    if (k > 0) widest = std::max(widest, cuts.back() - cuts[cuts.size() - 2]);
  }
  const double least = options_.min_share * patch_px * patch_px;
  const float per_pixel = 255.0f / static_cast<float>(FindddLanes::kOne * widest * widest);
  const float per_sum = 255.0f * static_cast<float>(cells * cells);

  const cv::Rect region = patches_region(grid, points, patch_px, size);
  const auto row_size = static_cast<std::size_t>(region.width + 1) * padded;
  const auto dimension_size = static_cast<std::size_t>(dimension());
  constexpr bool kBytes = std::is_same_v<Field, DescriptorField>;
  decltype(Field::values) values(points.size() * dimension_size);
  std::vector<std::uint8_t> described(points.size());
  std::vector<std::size_t> rows;  // first point of each row of the grid
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i == 0 || points[i] / grid.columns != points[i - 1] / grid.columns) rows.push_back(i);
  }
  parallel_for(static_cast<int>(rows.size()), threads, [&](int begin, int end) {
    // The last rows of the integral image; row r sums the normals above image row r.
    const int kept = patch_px + 1;
    std::vector<std::uint32_t> ring(row_size * static_cast<std::size_t>(kept));
    const auto slot = [&](int row) {
      return ring.data() + static_cast<std::size_t>(row % kept) * row_size;
    };
    std::vector<const std::uint32_t*> corners((sides + 1) * (sides + 1));
    std::vector<std::uint32_t> sums(sides * sides * padded);
    std::vector<std::uint8_t> bytes(dimension_size + 16);
    int done = -1;  // rows of the integral image up to this one are there
    for (int r = begin; r < end; ++r) {
      const auto first = rows[static_cast<std::size_t>(r)];
      const auto last = static_cast<std::size_t>(r) + 1 < rows.size()
                            ? rows[static_cast<std::size_t>(r) + 1]
                            : points.size();
      const int centre_y = grid.y(points[first] / grid.columns);
      PatchSpan patch_y(centre_y, patch_px);
      const int top = patch_y.begin;
      patch_y.clip(size.height);
      if (patch_y.begin > done) {
        done = patch_y.begin;
        std::fill_n(slot(done), row_size, 0u);
      }
      for (; done < patch_y.end; ++done) {
        kernel.integrate(layout, normals.ptr<float>(done) + 3 * region.x, region.width, slot(done),
                         slot(done + 1));
      }
      for (std::size_t i = first; i < last; ++i) {
        PatchSpan patch_x(grid.x(points[i] % grid.columns), patch_px);
        const int left = patch_x.begin;
        for (std::size_t row = 0; row <= sides; ++row) {
          const auto* line = slot(std::clamp(top + cuts[row], patch_y.begin, patch_y.end));
          for (std::size_t column = 0; column <= sides; ++column) {
            const int at = std::clamp(left + cuts[column], 0, size.width) - region.x;
            corners[column + (sides + 1) * row] = line + static_cast<std::size_t>(at) * padded;
          }
        }
        const auto counted = [&](std::size_t corner) { return corners[corner][bins]; };
        const std::uint32_t there = counted(corners.size() - 1) - counted(sides) -
                                    counted(corners.size() - 1 - sides) + counted(0);
        if (there == 0 || there < least) continue;
        kernel.sums(corners.data(), cells, lanes, sums.data());
        std::uint64_t total = 0;
        if (options_.l1) {
          for (std::size_t cell = 0; cell < sides * sides; ++cell)
            for (int bin = 0; bin < bins; ++bin)
              total += sums[cell * padded + static_cast<std::size_t>(bin)];
          if (total == 0) continue;
        }
        described[i] = 1;
        auto* out = values.data() + i * dimension_size;
        if constexpr (kBytes) {
          kernel.bytes(sums.data(), cells * cells, lanes, bins,
                       options_.l1 ? per_sum / static_cast<float>(total) : per_pixel, bytes.data());
          std::copy_n(bytes.data(), dimension_size, out);
        } else {
          const double unit = options_.l1 ? static_cast<double>(total) : FindddLanes::kOne;
          for (std::size_t cell = 0; cell < sides * sides; ++cell)
            for (int bin = 0; bin < bins; ++bin)
              *out++ =
                  static_cast<float>(sums[cell * padded + static_cast<std::size_t>(bin)] / unit);
        }
      }
    }
  });
  return make_field<Field>(grid, dimension(), points, described, std::move(values));
}

}  // namespace weft::descriptor
