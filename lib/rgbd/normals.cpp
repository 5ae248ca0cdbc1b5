#include "rgbd/normals.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "base/error.hpp"
#include "base/parallel.hpp"
#include "rgbd/normals_kernel.hpp"

namespace weft::rgbd {
namespace {

// What is nearer or further than any sensor measures is missing: squares of inverse depths stay
// finite.
constexpr float kNearest_m = 0.01f, kFarthest_m = 1000.0f;

const NormalsKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (path == SimdPath::kAvx2) return kNormalsAvx2;
#endif
  return kNormalsBaseline;
}

NormalWindow window_of(const CameraModel& camera, const NormalOptions& options) {
  const double f = std::min(camera.fx, camera.fy);
  NormalWindow window{};
  window.fx = static_cast<float>(camera.fx);
  window.fy = static_cast<float>(camera.fy);
  window.cx = static_cast<float>(camera.cx);
  window.cy = static_cast<float>(camera.cy);
  window.radius = static_cast<float>(options.radius_m);
  // A little more than whole pixels, so that no rounding decides about the outermost.
  window.min_tangent = static_cast<float>(2.01 / f);
  window.max_tangent = static_cast<float>((options.max_radius_px + 0.01) / f);
  window.gate = static_cast<float>(options.depth_gate_m);
  window.gate_noise = static_cast<float>(options.depth_noise_per_m);
  window.min_share = static_cast<float>(options.min_share);
  const auto reach = [&](double focal_px) {
    return std::min(NormalWindow::kMaxRadius,
                    static_cast<int>(focal_px * (options.max_radius_px + 0.02) / f));
  };
  window.max_u = reach(camera.fx);
  window.max_v = reach(camera.fy);
  for (int k = 0; k < NormalWindow::kMaxRadius + 2; ++k) {
    window.tangent_u[k] = static_cast<float>(k * k / (camera.fx * camera.fx));
    window.tangent_v[k] = static_cast<float>(k * k / (camera.fy * camera.fy));
  }
  return window;
}

}  // namespace

cv::Mat estimate_normals(const Surface& surface, const NormalOptions& options, int threads,
                         const cv::Mat& where, SimdPath path) {
  options.validate();
  const cv::Mat& points = surface.points_m;
  const int width = points.cols, height = points.rows;
  surface.camera.validate("the surface's camera");
  if (points.type() != CV_32FC3 || width != surface.camera.width || height != surface.camera.height)
    throw Error("normals need a surface with one point for each pixel of its camera");
  if (!where.empty() && (where.type() != CV_8UC1 || where.size() != points.size()))
    throw Error("the mask of the normals is not 8 bit or not of the surface's size");
  path = resolve_simd_path(path);
  if (!simd_path_available(path)) throw Error("this processor has no AVX2; use the baseline path");

  const NormalsKernel& kernel = kernel_of(path);
  const NormalWindow window = window_of(surface.camera, options);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  // Inverse depth with a border of missing points around, its width a multiple of eight.
  const int border = NormalWindow::kMaxRadius + 1;
  const cv::Size padded(((width + 7) & ~7) + 2 * border, height + 2 * border);
  cv::Mat inverse_depth(padded, CV_32FC1);
  parallel_for(padded.height, threads, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      float* out = inverse_depth.ptr<float>(row);
      std::fill(out, out + padded.width, nan);
      const int y = row - border;
      if (y < 0 || y >= height) continue;
      const auto* in = points.ptr<cv::Vec3f>(y);
      for (int x = 0; x < width; ++x) {
        const float z_m = in[x][2];
        if (z_m >= kNearest_m && z_m <= kFarthest_m) out[border + x] = 1.0f / z_m;
      }
    }
  });

  cv::Mat normals(points.size(), CV_32FC3);
  parallel_for(height, threads, [&](int begin, int end) {
    float out[24];
    for (int y = begin; y < end; ++y) {
      const std::uint8_t* needed = where.empty() ? nullptr : where.ptr(y);
      const float* in = inverse_depth.ptr<float>(y + border) + border;
      auto* normal = normals.ptr<cv::Vec3f>(y);
      for (int x = 0; x < width; x += 8) {
        const int pixels = std::min(8, width - x);
        if (needed &&
            std::all_of(needed + x, needed + x + pixels, [](std::uint8_t m) { return m == 0; })) {
          std::fill(normal + x, normal + x + pixels, cv::Vec3f(nan, nan, nan));
          continue;
        }
        kernel.eight(window, in + x, padded.width, x, y, out);
        for (int i = 0; i < pixels; ++i) normal[x + i] = {out[i], out[8 + i], out[16 + i]};
      }
    }
  });
  return normals;
}

}  // namespace weft::rgbd
