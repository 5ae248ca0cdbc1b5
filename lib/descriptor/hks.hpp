#pragma once

#include "base/simd.hpp"
#include "descriptor/depth_field.hpp"
#include "descriptor/hks_options.hpp"

namespace weft::descriptor {

/// Scale-invariant heat kernel signature (garment-parts.txt section 3.1; Bronstein and Kokkinos
/// 2010). k_t is the heat left at the point at time t = t_min 2^(i / samples_per_octave) after a
/// unit of it was put there, on the mesh of the patch around it (SurfaceMesh: cotangent weights,
/// lumped masses, millimetres). Value f is the magnitude at frequency f of the discrete Fourier
/// transform of d log k / d log2 t over the samples: a change of scale only shifts that signal.
/// 8 bit: min(255, round(255 sqrt(v / samples))); the square root because zero frequency is a
/// thousand times the last one.
///
/// Method "moments": k_t = e^-z (I_0(z) + 2 sum (-1)^j I_j(z) m_j), z = t lambda / 2, with m_j the
/// Chebyshev moments of the Laplacian scaled by a bound lambda of its eigenvalues, seen from the
/// centre. They come from products with the operator alone, two a product; each patch takes as many
/// as its bound asks for, until what is left out is below 1e-7. No eigenvalue is ever computed.
/// Method "eigenbasis": from the smallest eigenvalues and their eigenvectors (Spectra), the largest
/// times right, the smallest wrong.
///
/// Nothing is described where the point is missing or in no triangle, or less than min_coverage of
/// the patch hangs together with it. Needs only the frame's depth and images.mask.
class HksDescriptor : public DenseDescriptor {
 public:
  explicit HksDescriptor(const HksOptions& options, SimdPath path = SimdPath::kAuto);

  const std::string& name() const override;
  int dimension() const override { return options_.frequencies; }
  bool uses_colour() const override { return false; }
  DescriptorField describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                           const rgbd::ViewImages& images, const Grid& grid,
                           int threads) const override;
  /// The same at full precision, in patches of patch_px. mask: CV_8UC1 of the surface's size.
  FloatField describe_surface(const rgbd::Surface& surface, const cv::Mat& mask, const Grid& grid,
                              int patch_px, int threads) const;

 private:
  HksOptions options_;
  SimdPath path_;
};

}  // namespace weft::descriptor
