#pragma once

#include <array>

#include "base/simd.hpp"
#include "descriptor/depth_field.hpp"
#include "descriptor/finddd_options.hpp"

namespace weft::descriptor {

/// The Fast Integral Normal 3D descriptor (garment-parts.txt section 3.1, after Ramisa et al.
/// 2013): histograms of the normals in each of 4 x 4 cells of a patch.
///
/// Bins are directions c of unit length; a normal n votes max(0, 1 - |n - c| / R) for each, where R
/// is the least distance between two bins. Directions and normals are those of the view's frame:
/// the zenith, towards the viewer, is minus the optical axis in the sensor view and the table's
/// normal in the rectified one. The patch does not turn with the surface, so neither does the
/// descriptor: cloth turned about the zenith has other words, as in the paper; training shows it
/// turned.
///
/// Value bin + bins * (column + cells * row) is the cell's sum of votes. The patch's pixels are cut
/// at round(k * size / 4), so that cells differ by a pixel where the size is not a multiple of 4.
/// Votes are rounded to 1/4096 and added as integers: the sums are exact.
///
/// 8 bit: min(255, round(255 s / a)), a the number of pixels of the largest cell; with l1,
/// min(255, round(255 * 16 * s / sum of all)), so that votes spread evenly over the cells and
/// gathered in one bin give 255 there.
///
/// Nothing is described where too few of the patch's pixels have a normal. Needs only the frame's
/// depth and images.mask.
class FindddDescriptor : public DenseDescriptor {
 public:
  explicit FindddDescriptor(const FindddOptions& options, SimdPath path = SimdPath::kAuto);

  const std::string& name() const override;
  int dimension() const override;
  bool uses_colour() const override { return false; }
  DescriptorField describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                           const rgbd::ViewImages& images, const Grid& grid,
                           int threads) const override;
  /// The same of a surface, in patches of patch_px. mask: CV_8UC1 of the surface's size.
  DescriptorField describe_surface(const rgbd::Surface& surface, const cv::Mat& mask,
                                   const Grid& grid, int patch_px, int threads) const;
  /// The same at full precision: sums of votes; with l1, divided by the sum of all.
  FloatField sums_of_surface(const rgbd::Surface& surface, const cv::Mat& mask, const Grid& grid,
                             int patch_px, int threads) const;

 private:
  template <class Field>
  Field run(const rgbd::Surface& surface, const cv::Mat& mask, const Grid& grid, int patch_px,
            int threads) const;

  FindddOptions options_;
  SimdPath path_;
  std::vector<std::array<double, 3>> bins_;
  double radius_;
};

/// Directions towards the vertices of an octahedron, each of whose triangles is divided into four
/// `subdivisions` times, in the hemisphere towards the viewer (z <= 0, the equator included), in
/// the view's frame. From the zenith down; those of one height clockwise as seen from there, from
/// +x on.
std::vector<std::array<double, 3>> finddd_bins(int subdivisions);

}  // namespace weft::descriptor
