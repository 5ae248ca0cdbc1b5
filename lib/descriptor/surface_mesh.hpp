#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "rgbd/surface.hpp"

namespace weft::descriptor {

/// Triangle mesh over a part of a surface, with what its discrete Laplacian is made of. Each square
/// of four neighbouring points has two triangles: the upper one of the upper left, upper right and
/// lower left point, the lower one of the other three. A triangle is left out where a point is
/// missing, where it spans a depth jump (rgbd::kDepthJump for each pixel of the stride) or where it
/// is so thin that kMaxEigenvalue is exceeded.
///
/// All values are kept by the square's upper left point; those of triangles that are not there are
/// 0. An edge's cotangent weight is half the sum of the cotangents opposite to it, a point's mass a
/// third of its triangles' area.
class SurfaceMesh {
 public:
  /// Of one triangle's stiffness over its lumped mass, 1/mm^2: triangles lower than about 0.2 mm,
  /// which no sensor sees, and which would slow down every patch that holds one.
  static constexpr double kMaxEigenvalue = 225.0;

  /// Points at offset + stride * i of the surface, i in the region.
  SurfaceMesh(const rgbd::Surface& surface, int stride, cv::Point offset, cv::Rect region,
              int threads);

  cv::Rect region() const { return region_; }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y - region_.y) * static_cast<std::size_t>(region_.width) +
           static_cast<std::size_t>(x - region_.x);
  }

  enum Plane {
    kTop,        // half the cotangent opposite to the upper edge, of the upper triangle
    kLeft,       // ... to the left edge, of the upper triangle
    kBottom,     // ... to the lower edge, of the lower triangle
    kRight,      // ... to the right edge, of the lower triangle
    kDiagonal,   // ... to the edge between upper right and lower left, of both
    kUpperMass,  // a third of the triangle's area, mm^2
    kLowerMass,
    kPlanes
  };
  const float* plane(Plane plane) const { return planes_[plane].data(); }

  /// What is in a patch: points, as a part of the region.
  struct Patch {
    double max_eigenvalue = 0.0;  // no eigenvalue of the patch's Laplacian is larger; 0: no mesh
    int connected = 0;            // points that hang together with the given one
  };
  Patch inspect(cv::Rect patch, cv::Point centre) const;

  /// Which of the points of a patch hang together with the given one, row-major.
  std::vector<std::uint8_t> component(cv::Rect patch, cv::Point centre) const;

 private:
  enum Triangles : std::uint8_t { kUpper = 1, kLower = 2 };

  cv::Rect region_;
  std::vector<float> planes_[kPlanes];
  std::vector<float> eigenvalue_;  // largest of the square's triangles
  std::vector<std::uint8_t> triangles_;
};

}  // namespace weft::descriptor
