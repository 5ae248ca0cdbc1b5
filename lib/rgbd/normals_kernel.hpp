#pragma once

#include <cstddef>

/// Inner loop of the normals, compiled once for the baseline and once for AVX2. Each pixel's
/// operations come in a fixed order, without fused multiply-add: the same bits on each path.
namespace weft::rgbd {

struct NormalWindow {
  /// Greatest radius of a window, px: bounds the bits that counts are packed into.
  static constexpr int kMaxRadius = 15;

  float fx, fy, cx, cy;  // px
  float radius;          // m: of a window at depth 1 m, the tangent of half its angle
  float min_tangent;     // bounds of that tangent, whatever the depth
  float max_tangent;
  float gate;        // m
  float gate_noise;  // 1/m
  float min_share;
  int max_u, max_v;  // px: half the greatest window
  /// (k / fx)^2 and (k / fy)^2 for k = 0 ... kMaxRadius + 1
  float tangent_u[kMaxRadius + 2], tangent_v[kMaxRadius + 2];
};

struct NormalsKernel {
  /// Normals of the 8 pixels (x ... x + 7, y). inverse_depth: the first of them, in a plane of rows
  /// `stride` apart, NaN = missing, in which max_u columns and max_v rows around can be read.
  /// normals: 8 x, 8 y, 8 z.
  void (*eight)(const NormalWindow& window, const float* inverse_depth, std::ptrdiff_t stride,
                int x, int y, float* normals);
};

extern const NormalsKernel kNormalsBaseline;
#if defined(__x86_64__)
extern const NormalsKernel kNormalsAvx2;
#endif

}  // namespace weft::rgbd
