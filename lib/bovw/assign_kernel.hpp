#pragma once

#include <cstdint>

/// Nearest centre by integer dot products, compiled once for the baseline and once for AVX2.
namespace weft::bovw {

/// Centres come in groups of this many, interleaved by pairs of dimensions.
constexpr int kGroup = 8;

struct AssignKernel {
  /// packed[((g * pairs) + pair) * 2 * kGroup + 2 * word + i]: dimension 2 pair + i of the word's
  /// centre; norms: its squared norm, 2^30 where the group is padded. For each of count points of
  /// 2 * pairs 16-bit values: the word with the smallest norm - 2 x . c (of equals the smallest
  /// word), and that value.
  void (*nearest)(const std::int16_t* points, int count, int pairs, const std::int16_t* packed,
                  const std::int32_t* norms, int groups, std::int32_t* words, std::int32_t* values);
  /// Squared distances of count points of `dimension` 8-bit values to one centre.
  void (*distances)(const std::uint8_t* points, int count, int dimension,
                    const std::uint8_t* centre, std::int32_t* out);
};

extern const AssignKernel kAssignBaseline;
#if defined(__x86_64__)
extern const AssignKernel kAssignAvx2;
#endif

}  // namespace weft::bovw
