#pragma once

#include <cstdint>

/// Inner loops of dense SIFT, compiled once for the baseline and once for AVX2. Single precision,
/// each value's operations in a fixed order, no fused multiply-add: the same bits on each path.
namespace weft::descriptor {

constexpr int scratch_stride(int width) { return width + 8; }

struct SiftKernel {
  /// Orientation votes of a row, 8 floats a pixel, for the pixels [begin, end) of an image `width`
  /// wide. above, here, below: rows of grey values (the row itself at the image's edges);
  /// y_scale: 0.5, or 1 where above or below is the row itself. scratch:
  /// 3 * scratch_stride(width) floats.
  void (*votes)(const float* above, const float* here, const float* below, float y_scale, int begin,
                int end, int width, float* scratch, float* votes);
  /// out[i] = sum over taps of weights[tap] * rows[tap][i] for 8 * pixels values.
  void (*vertical)(const float* const* rows, const float* weights, int taps, int pixels,
                   float* out);
  /// For 8 orientations: out[o] = sum over taps of weights[tap] * in[8 tap + o].
  void (*horizontal)(const float* in, const float* weights, int taps, float* out);
  /// Sum of the histogram; the histogram of 128 becomes min(255, round(512 v)) of its normalised,
  /// clamped, normalised self. The sum must be positive.
  float (*mass)(const float* histogram);
  void (*finish)(const float* histogram, std::uint8_t* out);
  /// out[x] = sum over taps of weights[tap] * rows[tap][x], x in [0, width).
  void (*smooth_vertical)(const float* const* rows, const float* weights, int taps, int width,
                          float* out);
  /// out[x] = sum over taps of weights[tap] * in[x + tap], x in [0, width).
  void (*smooth_horizontal)(const float* in, const float* weights, int taps, int width, float* out);
};

extern const SiftKernel kSiftBaseline;
#if defined(__x86_64__)
extern const SiftKernel kSiftAvx2;
#endif

}  // namespace weft::descriptor
