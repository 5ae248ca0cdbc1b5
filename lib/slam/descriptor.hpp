#pragma once

#include <array>
#include <cstdint>

namespace weft::slam {

/// 256 binary tests (ORB: Rublee et al., ICCV 2011): the 32 bytes of a row of OpenCV's matrix, in
/// memory order.
using Descriptor = std::array<std::uint64_t, 4>;

/// Number of tests that differ. Adds the bits of all four words side by side: without a machine's
/// own instruction, which not every one has, four separate counts take twice as long.
inline int hamming_distance(const Descriptor& a, const Descriptor& b) {
  constexpr std::uint64_t kPairs = 0x5555555555555555u;
  constexpr std::uint64_t kNibbles = 0x3333333333333333u;
  constexpr std::uint64_t kBytes = 0x0f0f0f0f0f0f0f0fu;
  constexpr std::uint64_t kSum = 0x0101010101010101u;
  const auto by_nibble = [](std::uint64_t x) {
    x -= (x >> 1) & kPairs;
    return (x & kNibbles) + ((x >> 2) & kNibbles);
  };
  const auto of_two = [&](std::uint64_t x, std::uint64_t y) {  // up to 128: fits a byte
    const std::uint64_t both = by_nibble(x) + by_nibble(y);
    return (((both & kBytes) + ((both >> 4) & kBytes)) * kSum) >> 56;
  };
  return static_cast<int>(of_two(a[0] ^ b[0], a[1] ^ b[1]) + of_two(a[2] ^ b[2], a[3] ^ b[3]));
}

}  // namespace weft::slam
