#pragma once

#include <vector>

#include "descriptor/surface_mesh.hpp"

namespace weft::descriptor {

/// An eigenvalue of a patch's Laplacian, 1/mm^2, and the square of its normalised eigenvector at
/// the centre, such that k_t = sum weight exp(-t value).
struct HeatMode {
  double value = 0.0;
  double weight = 0.0;
};

/// The `count` smallest, or all when there are fewer, of the part of the patch that hangs together
/// with the centre: shift and invert with a slightly negative shift. Throws Error when they do not
/// converge. Spectra and Eigen's sparse solvers call libm only for the power of a constant, which
/// is the same with and without fused multiply-add, so the bits are as elsewhere.
std::vector<HeatMode> smallest_modes(const SurfaceMesh& mesh, cv::Rect patch, cv::Point centre,
                                     int count);

}  // namespace weft::descriptor
