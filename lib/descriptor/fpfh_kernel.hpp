#pragma once

#include <cstdint>

/// Inner loops of FPFH, compiled once for the baseline and once for AVX2. Single precision, each
/// value's operations in a fixed order, no fused multiply-add, counts in integers: the same bits on
/// each path.
namespace weft::descriptor {

constexpr int kFpfhBins = 11;    // of each of the three angles
constexpr int kFpfhGroup = 8;    // neighbouring points of a row, handled together
constexpr int kFpfhGroups = 8;   // groups in a call of count_pairs
constexpr int kFpfhMaxRun = 96;  // columns of offsets in a call: counts of 8 bit must hold them

/// Counts of a group: [bin][point][4], three angles and, in bin 0, the number of pairs.
constexpr int kFpfhGroupCounts = kFpfhBins * kFpfhGroup * 4;

/// Codes of pairs: a row an offset, with room for a group before and behind.
constexpr int kFpfhCodeStride = (kFpfhGroups + 2) * kFpfhGroup;
constexpr int kFpfhCodes = kFpfhMaxRun * kFpfhCodeStride;

/// Pairs of the points p[x] of one row with the points q[x + dx] of the same or another row.
struct FpfhPairs {
  /// Coordinates x, y, z (m; NaN = missing) and unit normal x, y, z of the points, at the column of
  /// the first group.
  const float* p[6];
  const float* q[6];
  float radius2_m2;
  /// Offsets dx of each group of p, none when first > last; all within kFpfhMaxRun columns. q must
  /// be readable at all of them.
  const int* first_dx;
  const int* last_dx;
  /// Groups [begin, end) of which pairs are counted, relative to the first group of p, and the
  /// counts of group `begin`. Those of p lie within the call's groups, those of q may reach beyond.
  int p_begin, p_end;
  int q_begin, q_end;
  std::uint16_t* p_counts;
  std::uint16_t* q_counts;
  /// kFpfhCodes values; all bits must be set at first.
  std::uint32_t* codes;
};

struct FpfhKernel {
  void (*count_pairs)(const FpfhPairs& pairs);
  /// Shares of a point's pairs in each bin, in percent, laid out as the counts; 0 without pairs.
  void (*normalise)(const std::uint16_t* counts, int groups, float* spfh);
  /// Adds the SPFH of the points of `groups` groups within the radius of the query, each weighted
  /// by 1 / squared distance, to sums[bin][8]: four for points of even, four for those of odd
  /// index. row: coordinates x, y, z of the points.
  void (*add_weighted)(const float* const* row, const float* spfh, int groups, const float* query,
                       float radius2_m2, float* sums);
};

extern const FpfhKernel kFpfhBaseline;
#if defined(__x86_64__)
extern const FpfhKernel kFpfhAvx2;
#endif

}  // namespace weft::descriptor
