#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/simd.hpp"

namespace weft::bovw {

/// Finds the nearest of some 8-bit centres, exactly. Of equally near ones, the first.
class Nearest {
 public:
  /// centres: words * dimension; dimension at most 4096, so that every sum fits 32 bit.
  Nearest(std::span<const std::uint8_t> centres, int dimension, SimdPath path = SimdPath::kAuto);

  /// points: words.size() * dimension. squared_distances may be empty.
  void find(std::span<const std::uint8_t> points, std::span<std::int32_t> words,
            std::span<std::int32_t> squared_distances) const;

 private:
  int dimension_;
  int pairs_;
  int groups_;
  SimdPath path_;
  std::vector<std::int16_t> packed_;
  std::vector<std::int32_t> norms_;
};

/// Squared distances of the points to one centre.
void squared_distances(std::span<const std::uint8_t> points, std::span<const std::uint8_t> centre,
                       std::span<std::int32_t> out, SimdPath path = SimdPath::kAuto);

}  // namespace weft::bovw
