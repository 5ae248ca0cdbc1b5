#pragma once

#include <cstddef>
#include <cstdint>

/// Inner loops of plane extraction, compiled once for the baseline and once for AVX2. Sums are
/// exact and pixels independent of each other: the same bits on each path.
namespace weft::plane {

/// Depth counts in [nearest, nearest + span] become inverse depths steps / depth, at most 2^22.
struct InverseDepthCode {
  static constexpr int kBits = 22;
  std::uint32_t nearest = 1;
  std::uint32_t span = 0;
  float steps = 0.0f;  // 2^22 * nearest
};

/// Sums over the rows of 8 columns. w counts a column's rows from its end: 1 for the last.
struct ColumnSums {
  std::uint32_t n[8];    // valid pixels
  std::uint32_t nw[8];   // sum of w
  std::uint32_t nww[8];  // sum of w (w + 1) / 2
  std::uint32_t d[8];    // sum of inverse depths, each rounded to a whole number
  std::uint32_t dw[8];   // sum of w d
  double dd[8];          // sum of d^2
};

/// A plane seen in a cell: inverse depth start + column * columns + row * rows, in units of the
/// code, and the distance from it up to which a pixel belongs to it.
struct CellPlane {
  float start, column, row, gate;
  std::int32_t label;
};

struct CellKernel {
  /// Most rows whose sums do not overflow, and most columns of a cell.
  static constexpr int kMaxCell = 40;
  /// Most planes that compete for a cell.
  static constexpr int kMaxPlanes = 64;

  /// Adds up `rows` rows, `stride` apart, of 8 * blocks columns.
  void (*columns)(const InverseDepthCode& code, const std::uint16_t* depth, std::ptrdiff_t stride,
                  int rows, int blocks, ColumnSums* sums);
  /// Of a cell of at most kMaxCell columns: the label of each pixel's nearest plane within its
  /// gate, 0 for none, and how many pixels each plane got. distances, kMaxCell to a row, unless
  /// null: from that plane, in units of the code; infinity for none.
  void (*label)(const InverseDepthCode& code, const std::uint16_t* depth, std::ptrdiff_t stride,
                int columns, int rows, const CellPlane* planes, int plane_count,
                std::uint8_t* labels, std::ptrdiff_t label_stride, int* counts, float* distances);
};

extern const CellKernel kCellBaseline;
#if defined(__x86_64__)
extern const CellKernel kCellAvx2;
#endif

}  // namespace weft::plane
