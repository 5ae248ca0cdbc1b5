#include "descriptor/dense_descriptor.hpp"

#include "base/error.hpp"
#include "descriptor/finddd.hpp"
#include "descriptor/fpfh.hpp"
#include "descriptor/gdh.hpp"
#include "descriptor/hks.hpp"
#include "descriptor/sift.hpp"

namespace weft::descriptor {

Grid make_grid(int width_px, int height_px, const GridOptions& options) {
  options.validate();
  const auto points = [&](int size) {
    const int span = size - 1 - 2 * options.border_px;
    return span < 0 ? 0 : span / options.step_px + 1;
  };
  return {options.border_px, options.border_px, options.step_px, points(width_px),
          points(height_px)};
}

std::unique_ptr<DenseDescriptor> make_descriptor(const DescriptorOptions& options, SimdPath path) {
  options.validate();
  switch (options.kind) {
    case DescriptorOptions::Kind::kSift:
      return std::make_unique<SiftDescriptor>(options.sift, path);
    case DescriptorOptions::Kind::kGdh:
      return std::make_unique<GdhDescriptor>(options.gdh);
    case DescriptorOptions::Kind::kFinddd:
      return std::make_unique<FindddDescriptor>(options.finddd, path);
    case DescriptorOptions::Kind::kFpfh:
      return std::make_unique<FpfhDescriptor>(options.fpfh, path);
    case DescriptorOptions::Kind::kHks:
      return std::make_unique<HksDescriptor>(options.hks, path);
  }
  throw Error("there is no such kind of descriptor");
}

}  // namespace weft::descriptor
