#include "descriptor/hks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <optional>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"
#include "descriptor/heat_series.hpp"
#include "descriptor/hks_eigenbasis.hpp"
#include "descriptor/hks_kernel.hpp"
#include "descriptor/surface_mesh.hpp"

namespace weft::descriptor {
namespace {

constexpr double kLn2 = 0.69314718055994530942;
constexpr double kPi = 3.14159265358979323846;

const HksKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (path == SimdPath::kAvx2) return kHksAvx2;
#endif
  return kHksBaseline;
}

// Cosine and sine by their Taylor series, -pi <= x <= pi, within 1e-15: the same bits everywhere.
void cos_sin(double x, double& cosine, double& sine) {
  cosine = sine = 1.0;
  for (int n = 32; n >= 2; n -= 2) {
    cosine = 1.0 - x * x / (n * (n - 1)) * cosine;
    sine = 1.0 - x * x / ((n + 1) * n) * sine;
  }
  sine *= x;
}

// Transform of real signals: the real parts of all frequencies, then the imaginary ones.
std::vector<double> fourier_table(int samples, int frequencies) {
  std::vector<double> table(static_cast<std::size_t>(samples * 2 * frequencies));
  for (int i = 0; i < samples; ++i) {
    double* row = table.data() + static_cast<std::ptrdiff_t>(i) * 2 * frequencies;
    for (int k = 0; k < frequencies; ++k) {
      const int turn = i * k % samples;  // of a full one, in samples
      const int signed_turn = 2 * turn > samples ? turn - samples : turn;
      cos_sin(2.0 * kPi * signed_turn / samples, row[k], row[frequencies + k]);
    }
  }
  return table;
}

// The mesh's points: every stride-th of the surface, such that the grid's points are among them.
struct Lattice {
  int stride, offset_x, offset_y, width, height, patch;
  Lattice(const cv::Mat& points, const Grid& grid, int stride_px, int patch_px)
      : stride(stride_px),
        offset_x(grid.origin_x % stride_px),
        offset_y(grid.origin_y % stride_px),
        width((points.cols - 1 - offset_x) / stride_px + 1),
        height((points.rows - 1 - offset_y) / stride_px + 1),
        patch(std::max(3, (patch_px + stride_px / 2) / stride_px)) {}
  cv::Point at(const Grid& grid, int cell) const {
    return {(grid.x(cell % grid.columns) - offset_x) / stride,
            (grid.y(cell / grid.columns) - offset_y) / stride};
  }
  cv::Rect patch_at(cv::Point centre) const {
    PatchSpan x(centre.x, patch), y(centre.y, patch);
    x.clip(width);
    y.clip(height);
    return {x.begin, y.begin, x.end - x.begin, y.end - y.begin};
  }
};

// Memory of one patch's operator and vectors, in the kernel's layout.
class PatchHeat {
 public:
  PatchHeat(const SurfaceMesh& mesh, int size, const HksKernel& kernel)
      : mesh_(mesh), kernel_(kernel) {
    op_.size = size;
    op_.stride = kHksPad + (size + kHksPad - 1) / kHksPad * kHksPad;
    block_ = static_cast<std::size_t>(op_.stride * (size + 2) + 2 * kHksPad);
    memory_.resize(block_ * kBlocks);
    op_.centre = plane(kCentre);
    op_.right = plane(kRightOf);
    op_.below = plane(kBelow);
    op_.rise = plane(kRise);
  }

  // Chebyshev moments 0 ... count - 1, count even, of the centre in the patch, which the image may
  // have clipped.
  void moments(cv::Rect patch, cv::Point centre, double bound, int count, double* out) {
    const int size = op_.size;
    const PatchSpan all_x(centre.x, size), all_y(centre.y, size);
    // The operator and the scratch planes are written where they count and zero elsewhere.
    const auto clear = [&](int from, int to) {
      std::fill(memory_.begin() + static_cast<std::ptrdiff_t>(block_) * from,
                memory_.begin() + static_cast<std::ptrdiff_t>(block_) * to, 0.0f);
    };
    clear(0, kScratch);
    clear(kCurrent, kBlocks);
    const float* planes[SurfaceMesh::kPlanes];
    for (int p = 0; p < SurfaceMesh::kPlanes; ++p) {
      planes[p] = plane(p);
      for (int y = patch.y; y + 1 < patch.y + patch.height; ++y) {
        std::copy_n(mesh_.plane(static_cast<SurfaceMesh::Plane>(p)) + mesh_.index(patch.x, y),
                    patch.width - 1,
                    plane(p) + (y - all_y.begin) * op_.stride + patch.x - all_x.begin);
      }
    }
    float* const scratch[] = {plane(kScratch), plane(kScratch + 1), plane(kScratch + 2)};
    kernel_.assemble(planes, static_cast<float>(4.0 / bound), scratch, op_);

    // T_0 is a one in the centre, T_1 = operator T_0 / 2, T_(j + 1) = operator T_j - T_(j - 1);
    // 2 T_i T_j = T_(i + j) + T_(i - j) gives two moments each.
    float *current = plane(kCurrent), *next = plane(kNext);
    const int row = centre.y - all_y.begin;
    const std::ptrdiff_t at = row * op_.stride + centre.x - all_x.begin;
    next[at] = 1.0f;
    current[at] = 0.5f * op_.centre[at];
    current[at + 1] = 0.5f * op_.right[at];
    current[at - 1] = 0.5f * op_.right[at - 1];
    current[at + op_.stride] = 0.5f * op_.below[at];
    current[at - op_.stride] = 0.5f * op_.below[at - op_.stride];
    current[at + op_.stride - 1] = 0.5f * op_.rise[at - 1];
    current[at - op_.stride + 1] = 0.5f * op_.rise[at - op_.stride];
    out[0] = 1.0;
    out[1] = current[at];
    for (int j = 2; j < count; j += 2) {
      // Here current is T_(j / 2) and next T_(j / 2 - 1).
      double same, neighbours;
      if (j == 2) {
        same = 0.0;
        for (std::ptrdiff_t y = -1; y <= 1; ++y) {
          for (std::ptrdiff_t x = -1; x <= 1; ++x) {
            const double value = current[at + y * op_.stride + x];
            same += value * value;
          }
        }
        out[2] = 2.0 * same - 1.0;
      }
      // Nothing is further from the centre than one row for each product.
      kernel_.step(op_, current, next, std::max(0, row - j / 2 - 1),
                   std::min(size, row + j / 2 + 2), &same, &neighbours);
      std::swap(current, next);
      out[j + 1] = 2.0 * neighbours - out[1];
      if (j + 2 < count) out[j + 2] = 2.0 * same - 1.0;
    }
  }

 private:
  // Blocks of memory after the mesh's planes.
  enum {
    kScratch = SurfaceMesh::kPlanes,
    kCentre = kScratch + 3,
    kRightOf,
    kBelow,
    kRise,
    kCurrent,
    kNext,
    kBlocks
  };
  float* plane(int block) {
    return memory_.data() + static_cast<std::size_t>(block) * block_ + op_.stride + kHksPad;
  }

  const SurfaceMesh& mesh_;
  const HksKernel& kernel_;
  HksOperator op_;
  std::size_t block_;
  std::vector<float> memory_;
};

}  // namespace

HksDescriptor::HksDescriptor(const HksOptions& options, SimdPath path)
    : options_(options), path_(resolve_simd_path(path)) {
  options_.validate();
  if (!simd_path_available(path_)) throw Error("this processor has no AVX2; use the baseline path");
}

const std::string& HksDescriptor::name() const {
  static const std::string name = "hks";
  return name;
}

DescriptorField HksDescriptor::describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                                        const rgbd::ViewImages& images, const Grid& grid,
                                        int threads) const {
  const auto samples = static_cast<float>(options_.samples());
  return to_bytes(
      describe_surface(rgbd::render_surface(frame, view), images.mask, grid,
                       patch_size_px(view, options_.patch_px, options_.patch_mm), threads),
      [&](float v) { return 255.0f * std::sqrt(v / samples); });
}

FloatField HksDescriptor::describe_surface(const rgbd::Surface& surface, const cv::Mat& mask,
                                           const Grid& grid, int patch_px, int threads) const {
  const auto cells = masked_cells(surface, mask, grid, "HKS");
  if (grid.step_px % options_.stride_px != 0) {
    throw Error("HKS: stride_px " + std::to_string(options_.stride_px) +
                " does not divide the grid's step of " + std::to_string(grid.step_px) + " px");
  }
  const Lattice lattice(surface.points_m, grid, options_.stride_px, patch_px);
  cv::Rect region;
  for (const int cell : cells) region |= lattice.patch_at(lattice.at(grid, cell));
  const SurfaceMesh mesh(surface, lattice.stride, {lattice.offset_x, lattice.offset_y}, region,
                         threads);

  // Which points there is something to describe at, and how fine their mesh is.
  const int per_octave = options_.samples_per_octave, samples = options_.samples();
  const auto count = static_cast<int>(cells.size());
  const double wanted = options_.min_coverage * lattice.patch * lattice.patch;
  std::vector<std::uint8_t> described(cells.size());
  std::vector<int> steps(cells.size());
  parallel_for(count, threads, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      const cv::Point centre = lattice.at(grid, cells[static_cast<std::size_t>(i)]);
      const auto patch = mesh.inspect(lattice.patch_at(centre), centre);
      if (!(patch.max_eigenvalue > 0.0) || patch.connected < 2 || patch.connected < wanted)
        continue;
      described[static_cast<std::size_t>(i)] = 1;
      steps[static_cast<std::size_t>(i)] = HeatSeries::step_for(patch.max_eigenvalue, per_octave);
    }
  });
  int first = std::numeric_limits<int>::max(), last = std::numeric_limits<int>::min();
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (!described[i]) continue;
    first = std::min(first, steps[i]);
    last = std::max(last, steps[i]);
  }
  const auto size = static_cast<std::size_t>(options_.frequencies);
  std::vector<float> values(cells.size() * size);
  if (last < first) return make_field(grid, dimension(), cells, described, std::move(values));

  const bool moments = options_.method == HksOptions::Method::kMoments;
  const HksKernel& kernel = kernel_of(path_);
  std::optional<HeatSeries> series;
  if (moments) series.emplace(options_.t_min_mm2, samples, per_octave, first, last);
  const std::vector<double> table = fourier_table(samples, options_.frequencies);
  parallel_for(count, threads, [&](int begin, int end) {
    PatchHeat heat(mesh, lattice.patch, kernel);
    std::vector<double> series_values, signal(static_cast<std::size_t>(samples)),
        spectrum(2 * size);
    for (int i = begin; i < end; ++i) {
      if (!described[static_cast<std::size_t>(i)]) continue;
      const cv::Point centre = lattice.at(grid, cells[static_cast<std::size_t>(i)]);
      const cv::Rect patch = lattice.patch_at(centre);
      if (moments) {
        const int step = steps[static_cast<std::size_t>(i)];
        const int terms = series->most(step);
        series_values.resize(static_cast<std::size_t>(terms));
        heat.moments(patch, centre, HeatSeries::bound(step, per_octave), terms,
                     series_values.data());
        for (std::size_t j = 1; j < series_values.size(); ++j)
          series_values[j] *= j % 2 ? -2.0 : 2.0;
        for (int sample = 0; sample < samples; ++sample) {
          const auto row = series->row(step, sample);
          double sum, change;
          kernel.expand(row.values, series_values.data(), row.count, &sum, &change);
          signal[static_cast<std::size_t>(sample)] = kLn2 * row.z * change / sum;
        }
      } else {
        const auto modes = smallest_modes(mesh, patch, centre, options_.eigenpairs);
        for (int sample = 0; sample < samples; ++sample) {
          const double t =
              options_.t_min_mm2 * det::exp(kLn2 * sample / static_cast<double>(per_octave));
          double sum = 0.0, change = 0.0;
          for (const auto& mode : modes) {
            const double left = mode.weight * det::exp(-t * mode.value);
            sum += left;
            change -= t * mode.value * left;
          }
          signal[static_cast<std::size_t>(sample)] = kLn2 * change / sum;
        }
      }
      kernel.transform(signal.data(), samples, table.data(), 2 * options_.frequencies,
                       spectrum.data());
      float* out = values.data() + static_cast<std::size_t>(i) * size;
      for (std::size_t k = 0; k < size; ++k) {
        const double re = spectrum[k], im = spectrum[size + k];
        out[k] = static_cast<float>(std::sqrt(re * re + im * im));
      }
    }
  });
  return make_field(grid, dimension(), cells, described, std::move(values));
}

}  // namespace weft::descriptor
