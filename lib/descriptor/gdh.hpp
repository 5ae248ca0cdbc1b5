#pragma once

#include "descriptor/depth_field.hpp"
#include "descriptor/gdh_options.hpp"

namespace weft::descriptor {

/// Geodesic-depth histogram (garment-parts.txt section 3.1, after Ling and Jacobs 2005): how depth
/// relative to the centre is distributed at each geodesic distance from it. The surface is the
/// metric one, distances are those of GeodesicMarcher within the patch, depth is z of the surface
/// (away from the camera is positive). Each point votes for one bin; every geodesic bin that has
/// votes is divided by their number, then the whole by its L2 norm. Value
/// depth_bin + depth_bins * geodesic_bin; 8 bit: min(255, round(512 v)).
///
/// Nothing is described where the point is missing or fewer than min_points are reached. Needs only
/// the frame's depth and images.mask.
class GdhDescriptor : public DenseDescriptor {
 public:
  explicit GdhDescriptor(const GdhOptions& options);

  const std::string& name() const override;
  int dimension() const override { return options_.geodesic_bins * options_.depth_bins; }
  bool uses_colour() const override { return false; }
  DescriptorField describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                           const rgbd::ViewImages& images, const Grid& grid,
                           int threads) const override;
  /// The same at full precision, in patches of patch_px. mask: CV_8UC1 of the surface's size.
  FloatField describe_surface(const rgbd::Surface& surface, const cv::Mat& mask, const Grid& grid,
                              int patch_px, int threads) const;

 private:
  GdhOptions options_;
};

}  // namespace weft::descriptor
