#pragma once

#include "base/simd.hpp"
#include "descriptor/dense_descriptor.hpp"

namespace weft::descriptor {

/// Dense SIFT with the geometry of VLFeat's vl_dsift: gradients by central half differences, linear
/// votes into 2 of 8 orientations, triangle of half-width bin_px around each of 4 x 4 bin centres
/// times a Gaussian weight, L2 -> clamp at 0.2 -> L2. Value t + 8 (x + 4 y), orientation t, bin
/// column x and row y, is min(255, round(512 v)).
///
/// The frame's centre is the grid point; with an odd bin_px, half a pixel right of and below it.
/// Samples beyond the image repeat its edge. Only `images.colour` and `images.mask` are used.
class SiftDescriptor : public DenseDescriptor {
 public:
  static constexpr int kDimension = 128;

  explicit SiftDescriptor(const SiftOptions& options, SimdPath path = SimdPath::kAuto);

  const std::string& name() const override;
  int dimension() const override { return kDimension; }
  bool uses_colour() const override { return true; }
  DescriptorField describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                           const rgbd::ViewImages& images, const Grid& grid,
                           int threads) const override;
  /// The same from the images alone. colour: CV_8UC3 (BGR) or CV_8UC1; mask: CV_8UC1 of its size.
  DescriptorField describe_image(const cv::Mat& colour, const cv::Mat& mask, const Grid& grid,
                                 int threads) const;

 private:
  SiftOptions options_;
  SimdPath path_;
};

}  // namespace weft::descriptor
