#pragma once

#include <cstdint>

/// Inner loops of FINDDD, compiled once for the baseline and once for AVX2. Votes are integers,
/// each from operations in a fixed order without fused multiply-add: the same bits on each path.
namespace weft::descriptor {

/// Bins side by side, padded to a multiple of 16 lanes; the lane after the last bin counts normals.
struct FindddLanes {
  static constexpr int kOne = 4096;  // a whole vote

  int bins = 0;
  int lanes = 0;
  bool soft = true;
  const float *x = nullptr, *y = nullptr, *z = nullptr;  // 0 in lanes that are not bins
  const float* inverse_radius = nullptr;                 // large there, so that they get no votes
  const std::int32_t* constant = nullptr;                // added for each normal: 1 in the counter
};

struct FindddKernel {
  /// A row of the integral image: out[lane + lanes (i + 1)] is the same of `above` plus the votes
  /// of the normals 0 ... i, of which those with NaN have none. normals: x, y, z of each of
  /// `width`.
  void (*integrate)(const FindddLanes& lanes, const float* normals, int width,
                    const std::uint32_t* above, std::uint32_t* out);
  /// Sums of cells x cells cells, lanes values each, from the integral image at their corners:
  /// corners[column + (cells + 1) row].
  void (*sums)(const std::uint32_t* const* corners, int cells, int lanes, std::uint32_t* out);
  /// The bins of each cell as min(255, round(factor sum)), close together. 16 bytes behind the last
  /// are overwritten.
  void (*bytes)(const std::uint32_t* sums, int cells, int lanes, int bins, float factor,
                std::uint8_t* out);
};

extern const FindddKernel kFindddBaseline;
#if defined(__x86_64__)
extern const FindddKernel kFindddAvx2;
#endif

}  // namespace weft::descriptor
