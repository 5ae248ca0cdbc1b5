#pragma once

#include "base/simd.hpp"
#include "descriptor/depth_field.hpp"
#include "descriptor/fpfh_options.hpp"

namespace weft::descriptor {

/// Fast Point Feature Histograms (garment-parts.txt section 3.1; Rusu, Blodow and Beetz 2009), as
/// PCL's FPFHEstimation defines them.
///
/// Of two points within radius_m of each other, the source is the one whose normal u makes the
/// smaller angle with the line between them (the upper, or left one, if they are equal); n is the
/// other's normal. With d from the source to the other, v = d x u / |d x u| and w = u x v, the pair
/// has the angles
///   f1 = atan2(w . n, u . n),  f2 = v . n,  f3 = u . d / |d|,
/// each in one of 11 bins over [-pi, pi], [-1, 1] and [-1, 1]. On the edge of two bins, f1 belongs
/// to the one nearer the middle, f2 and f3 to the other, as far as single precision tells. Pairs
/// with |d x u| below 0.1 nm (in one place, or along the normal) do not count. The simplified
/// histogram (SPFH) of a point is the share of its pairs in each bin. The FPFH of a point is the
/// sum of its neighbours' SPFH, its own left out, each weighted by 1 / d^2, each block of 11 scaled
/// to 100.
///
/// Values: f1, f2, f3; in 8 bit min(255, round(2.55 v)).
///
/// The whole surface counts, not only what lies inside the mask. Points without a normal are
/// missing, and so is what is too near for the camera: where the radius would cover more than 65535
/// px (at 2.5 cm and f = 525 px, nearer than 12 to 14 cm). Nothing is described where the point is
/// missing or has fewer than min_neighbours pairs.
///
/// PCL differs where the result would depend on the order of points: between normals at equal
/// angles the source is the point whose SPFH it computes, and a neighbour without SPFH gets that of
/// another point.
///
/// The rectified view samples the surface anew, at the view's scale. The radius stays metric; what
/// changes is how many samples a piece of cloth has: pieces which the camera saw aslant or from
/// afar weigh more than in the sensor view, and depth interpolated between pixels is smoother.
class FpfhDescriptor : public DenseDescriptor {
 public:
  static constexpr int kDimension = 33;

  explicit FpfhDescriptor(const FpfhOptions& options, SimdPath path = SimdPath::kAuto);

  const std::string& name() const override;
  int dimension() const override { return kDimension; }
  bool uses_colour() const override { return false; }
  DescriptorField describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                           const rgbd::ViewImages& images, const Grid& grid,
                           int threads) const override;
  /// The same at full precision. normals: CV_32FC3 of the surface's size, unit length, NaN = none;
  /// mask: CV_8UC1 of that size.
  FloatField describe_surface(const rgbd::Surface& surface, const cv::Mat& normals,
                              const cv::Mat& mask, const Grid& grid, int threads) const;

 private:
  FpfhOptions options_;
  SimdPath path_;
};

}  // namespace weft::descriptor
