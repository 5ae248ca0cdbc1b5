#pragma once

#include <cstddef>

/// Inner loops of the heat kernel signature, compiled once for the baseline and once for AVX2. Each
/// value's operations have a fixed order, no fused multiply-add: the same bits on each path.
namespace weft::descriptor {

/// Rows of a square patch in memory: kHksPad floats of zero, the row, zeros up to a multiple of
/// kHksPad; one row of zeros above and below. Pointers are to the first value of the first row.
inline constexpr int kHksPad = 8;

/// The symmetric operator (4 / lambda) M^-1/2 L M^-1/2 - 2 of a patch: the weight of each point and
/// of its edges to the right, below, and from the point right of it to the one below it.
struct HksOperator {
  int size = 0;               // points along a side
  std::ptrdiff_t stride = 0;  // from row to row
  float* centre = nullptr;
  float* right = nullptr;
  float* below = nullptr;
  float* rise = nullptr;
};

struct HksKernel {
  /// Fills an operator from the planes of the patch's mesh (SurfaceMesh::Plane, in this layout).
  /// scratch: three more planes of the layout. scale: 4 / lambda.
  void (*assemble)(const float* const* planes, float scale, float* const* scratch,
                   const HksOperator& out);
  /// next = operator * current - next for the rows [begin, end); the dot products of the new next
  /// with itself and with current, over those rows.
  void (*step)(const HksOperator& op, const float* current, float* next, int begin, int end,
               double* next_next, double* next_current);
  /// sum of a[j] row[j + 1] and of a[j] ((row[j] + row[j + 2]) / 2 - row[j + 1]) for j in [0,
  /// count), a multiple of 8.
  void (*expand)(const double* row, const double* a, int count, double* sum, double* change);
  /// out[k] = sum over i of signal[i] * table[i * width + k], k in [0, width).
  void (*transform)(const double* signal, int count, const double* table, int width, double* out);
};

extern const HksKernel kHksBaseline;
#if defined(__x86_64__)
extern const HksKernel kHksAvx2;
#endif

}  // namespace weft::descriptor
