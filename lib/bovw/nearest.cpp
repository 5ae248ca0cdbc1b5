#include "bovw/nearest.hpp"

#include <algorithm>

#include "bovw/assign_kernel.hpp"

namespace weft::bovw {
namespace {

const AssignKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (resolve_simd_path(path) == SimdPath::kAvx2) return kAssignAvx2;
#endif
  (void)path;
  return kAssignBaseline;
}

}  // namespace

Nearest::Nearest(std::span<const std::uint8_t> centres, int dimension, SimdPath path)
    : dimension_(dimension), pairs_((dimension + 1) / 2), path_(path) {
  const int words = static_cast<int>(centres.size()) / dimension;
  groups_ = (words + kGroup - 1) / kGroup;
  packed_.resize(static_cast<std::size_t>(groups_ * pairs_ * 2 * kGroup));
  norms_.assign(static_cast<std::size_t>(groups_ * kGroup), 1 << 30);
  for (int word = 0; word < words; ++word) {
    const auto* centre = centres.data() + static_cast<std::ptrdiff_t>(word) * dimension;
    std::int32_t norm = 0;
    for (int d = 0; d < dimension; ++d) {
      norm += centre[d] * centre[d];
      const int at = ((word / kGroup) * pairs_ + d / 2) * 2 * kGroup + 2 * (word % kGroup) + d % 2;
      packed_[static_cast<std::size_t>(at)] = centre[d];
    }
    norms_[static_cast<std::size_t>(word)] = norm;
  }
}

void Nearest::find(std::span<const std::uint8_t> points, std::span<std::int32_t> words,
                   std::span<std::int32_t> squared) const {
  constexpr int kBlock = 48;
  const auto wide_size = static_cast<std::size_t>(2 * pairs_);
  std::vector<std::int16_t> wide(kBlock * wide_size);
  std::int32_t values[kBlock];
  const int count = static_cast<int>(words.size());
  for (int begin = 0; begin < count; begin += kBlock) {
    const int size = std::min(kBlock, count - begin);
    const auto* first = points.data() + static_cast<std::ptrdiff_t>(begin) * dimension_;
    for (int p = 0; p < size; ++p) {
      std::copy_n(
          first + static_cast<std::ptrdiff_t>(p) * dimension_, dimension_,
          wide.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(p) * wide_size));
    }
    kernel_of(path_).nearest(wide.data(), size, pairs_, packed_.data(), norms_.data(), groups_,
                             words.data() + begin, values);
    if (squared.empty()) continue;
    for (int p = 0; p < size; ++p) {
      std::int32_t norm = values[p];
      const auto* point = first + static_cast<std::ptrdiff_t>(p) * dimension_;
      for (int d = 0; d < dimension_; ++d) norm += point[d] * point[d];
      squared[static_cast<std::size_t>(begin + p)] = norm;
    }
  }
}

void squared_distances(std::span<const std::uint8_t> points, std::span<const std::uint8_t> centre,
                       std::span<std::int32_t> out, SimdPath path) {
  kernel_of(path).distances(points.data(), static_cast<int>(out.size()),
                            static_cast<int>(centre.size()), centre.data(), out.data());
}

}  // namespace weft::bovw
