#include "descriptor/surface_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/parallel.hpp"

namespace weft::descriptor {
namespace {

struct Triangle {
  double cot_a = 0, cot_b = 0, cot_c = 0;  // halved
  double mass = 0;                         // of each corner, mm^2
  double eigenvalue = 0;                   // 0: no triangle
};

bool finite(const cv::Vec3f& p) {
  return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

bool jump(const cv::Vec3f& a, const cv::Vec3f& b, double limit) {
  return std::abs(double{a[2]} - b[2]) > limit * std::min(std::abs(a[2]), std::abs(b[2]));
}

Triangle triangle(const cv::Vec3f& a, const cv::Vec3f& b, const cv::Vec3f& c, double jump_limit) {
  if (!finite(a) || !finite(b) || !finite(c) || jump(a, b, jump_limit) || jump(a, c, jump_limit) ||
      jump(b, c, jump_limit)) {
    return {};
  }
  const double ux = 1000.0 * (double{b[0]} - a[0]), uy = 1000.0 * (double{b[1]} - a[1]),
               uz = 1000.0 * (double{b[2]} - a[2]), vx = 1000.0 * (double{c[0]} - a[0]),
               vy = 1000.0 * (double{c[1]} - a[1]), vz = 1000.0 * (double{c[2]} - a[2]);
  const double nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
  const double squared = nx * nx + ny * ny + nz * nz;  // of twice the area
  const double uu = ux * ux + uy * uy + uz * uz, vv = vx * vx + vy * vy + vz * vz,
               uv = ux * vx + uy * vy + uz * vz;
  // The stiffness of a triangle has the eigenvalue 0 and two with the sum and product that follow
  // from its edges; the largest of all triangles bounds the mesh's.
  const double edges = uu + vv + (uu + vv - 2.0 * uv);
  const double root = std::sqrt(std::max(0.0, edges * edges - 12.0 * squared));
  const double eigenvalue = 3.0 * (edges + root) / (2.0 * squared);
  if (!(eigenvalue <= SurfaceMesh::kMaxEigenvalue)) return {};
  const double twice = std::sqrt(squared);
  return {0.5 * uv / twice, 0.5 * (uu - uv) / twice, 0.5 * (vv - uv) / twice, twice / 6.0,
          eigenvalue};
}

}  // namespace

SurfaceMesh::SurfaceMesh(const rgbd::Surface& surface, int stride, cv::Point offset,
                         cv::Rect region, int threads)
    : region_(region) {
  const auto size =
      static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height);
  for (auto& plane : planes_) plane.assign(size, 0.0f);
  eigenvalue_.assign(size, 0.0f);
  triangles_.assign(size, 0);
  const double jump_limit = rgbd::kDepthJump * stride;
  parallel_for(region.height - 1, threads, [&](int begin, int end) {
    for (int y = region.y + begin; y < region.y + end; ++y) {
      const auto* above = surface.points_m.ptr<cv::Vec3f>(offset.y + stride * y) + offset.x;
      const auto* below = surface.points_m.ptr<cv::Vec3f>(offset.y + stride * (y + 1)) + offset.x;
      for (int x = region.x; x + 1 < region.x + region.width; ++x) {
        const cv::Vec3f &a = above[stride * x], &b = above[stride * (x + 1)],
                        &c = below[stride * x], &d = below[stride * (x + 1)];
        const Triangle upper = triangle(a, b, c, jump_limit);
        const Triangle lower = triangle(d, c, b, jump_limit);
        const auto i = index(x, y);
        planes_[kTop][i] = static_cast<float>(upper.cot_c);
        planes_[kLeft][i] = static_cast<float>(upper.cot_b);
        planes_[kBottom][i] = static_cast<float>(lower.cot_c);
        planes_[kRight][i] = static_cast<float>(lower.cot_b);
        planes_[kDiagonal][i] = static_cast<float>(upper.cot_a + lower.cot_a);
        planes_[kUpperMass][i] = static_cast<float>(upper.mass);
        planes_[kLowerMass][i] = static_cast<float>(lower.mass);
        eigenvalue_[i] = static_cast<float>(std::max(upper.eigenvalue, lower.eigenvalue));
        triangles_[i] = static_cast<std::uint8_t>((upper.eigenvalue > 0 ? kUpper : 0) |
                                                  (lower.eigenvalue > 0 ? kLower : 0));
      }
    }
  });
}

SurfaceMesh::Patch SurfaceMesh::inspect(cv::Rect patch, cv::Point centre) const {
  Patch result;
  float largest = 0.0f;
  bool whole = true;
  for (int y = patch.y; y + 1 < patch.y + patch.height; ++y) {
    const auto first = index(patch.x, y);
    for (std::size_t i = first; i + 1 < first + static_cast<std::size_t>(patch.width); ++i) {
      largest = std::max(largest, eigenvalue_[i]);
      whole = whole && triangles_[i] == (kUpper | kLower);
    }
  }
  result.max_eigenvalue = largest;
  if (whole) {
    result.connected = patch.area();
  } else {
    for (const auto in : component(patch, centre)) result.connected += in;
  }
  return result;
}

std::vector<std::uint8_t> SurfaceMesh::component(cv::Rect patch, cv::Point centre) const {
  const std::ptrdiff_t width = patch.width;
  std::vector<std::uint8_t> in(static_cast<std::size_t>(patch.area()), 0);
  std::vector<cv::Point> open = {centre};
  in[static_cast<std::size_t>((centre.y - patch.y) * width + centre.x - patch.x)] = 1;
  const auto reach = [&](int x, int y) {
    auto& known = in[static_cast<std::size_t>((y - patch.y) * width + x - patch.x)];
    if (!known) open.push_back({x, y});
    known = 1;
  };
  // The squares that a point is the upper left, upper right, lower left and lower right of; which
  // of its triangles the point is in, and the other corners of each.
  while (!open.empty()) {
    const auto [x, y] = open.back();
    open.pop_back();
    for (int square_y = std::max(y - 1, patch.y);
         square_y <= std::min(y, patch.y + patch.height - 2); ++square_y) {
      for (int square_x = std::max(x - 1, patch.x);
           square_x <= std::min(x, patch.x + patch.width - 2); ++square_x) {
        const auto triangles = triangles_[index(square_x, square_y)];
        const int corner = x - square_x + y - square_y;  // 0 upper left, 2 lower right
        if ((triangles & kUpper) && corner < 2) {
          reach(square_x, square_y);
          reach(square_x + 1, square_y);
          reach(square_x, square_y + 1);
        }
        if ((triangles & kLower) && corner > 0) {
          reach(square_x + 1, square_y + 1);
          reach(square_x + 1, square_y);
          reach(square_x, square_y + 1);
        }
      }
    }
  }
  return in;
}

}  // namespace weft::descriptor
