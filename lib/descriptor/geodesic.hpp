#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "rgbd/surface.hpp"

/// Geodesic distances on a surface seen as a grid of points, by fast marching.
namespace weft::descriptor {

/// Lengths of the edges between neighbouring points of a part of a surface. There is no edge to a
/// missing point and none across a depth jump (rgbd::kDepthJump).
class SurfaceEdges {
 public:
  SurfaceEdges(const rgbd::Surface& surface, cv::Rect region, int threads);

  /// Edges kept at the pixel (x, y): to the right, down, down right, and that which crosses the
  /// last, from the pixel right of it to the pixel below it. Millimetres; infinity for no edge.
  enum Edge { kRight, kDown, kFall, kRise };
  cv::Rect region() const { return region_; }
  bool valid(int x, int y) const { return valid_[index(x, y)] != 0; }
  const float* lengths_mm() const { return lengths_mm_.data(); }  // 4 a pixel, row-major
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y - region_.y) * static_cast<std::size_t>(region_.width) +
           static_cast<std::size_t>(x - region_.x);
  }

 private:
  cv::Rect region_;
  std::vector<float> lengths_mm_;
  std::vector<std::uint8_t> valid_;
};

/// Fast marching (Kimmel and Sethian 1998) from one point over the square patch around it. The
/// surface is that of all four triangles of each grid square. Points are accepted in the exact
/// order of their distances by a heap. Through a triangle the front goes as a circle around the
/// source that its two corners' distances imply (Novotni and Klein 2002), not as a line: exact on
/// planes, where a line is 4 % off beside the source, 0.03 mm off at 28 mm on a cylinder of 20 mm
/// radius, half a step of the grid behind the corner of a hole.
class GeodesicMarcher {
 public:
  struct Reached {
    int x = 0, y = 0;  // px of the surface
    float distance_mm = 0;
  };

  GeodesicMarcher(const SurfaceEdges& edges, int patch_px);

  /// The points nearer than max_mm in ascending order of their distance; ties in image order.
  /// Empty when the point itself is missing.
  const std::vector<Reached>& march(int x, int y, float max_mm);

 private:
  float through_triangles(std::size_t at, std::size_t edge, int direction, float distance) const;
  void push(std::uint64_t key);
  std::uint64_t pop();

  const SurfaceEdges& edges_;
  int patch_px_;
  std::ptrdiff_t stride_;        // of the patch with a border of one point
  std::ptrdiff_t local_[8];      // to the neighbours, in the patch
  std::ptrdiff_t edge_[8];       // to the edges to the neighbours, in lengths_mm()
  std::vector<float> distance_;  // of accepted and of tried points
  std::vector<std::uint8_t> status_;
  std::vector<std::uint64_t> heap_;
  std::vector<Reached> reached_;
};

}  // namespace weft::descriptor
