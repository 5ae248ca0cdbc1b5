#pragma once

#include "descriptor/dense_descriptor.hpp"

/// What tests of every descriptor share.
namespace weft::test {

/// All five, with their default options; HKS coarser, so that a test takes no minutes.
inline std::vector<descriptor::DescriptorOptions> all_kinds() {
  using Kind = descriptor::DescriptorOptions::Kind;
  std::vector<descriptor::DescriptorOptions> all;
  for (const auto kind : {Kind::kSift, Kind::kFinddd, Kind::kFpfh, Kind::kGdh, Kind::kHks}) {
    all.emplace_back();
    all.back().kind = kind;
    all.back().hks.stride_px = 2;
  }
  return all;
}

}  // namespace weft::test
