#include "descriptor/geodesic.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "base/parallel.hpp"
#include "descriptor/depth_field.hpp"

namespace weft::descriptor {
namespace {

constexpr float kNone = std::numeric_limits<float>::infinity();

bool finite(const cv::Vec3f& p) {
  return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

float length_mm(const cv::Vec3f& a, const cv::Vec3f& b) {
  if (!finite(a) || !finite(b)) return kNone;
  const double x = double{a[0]} - b[0], y = double{a[1]} - b[1], z = double{a[2]} - b[2];
  const double nearest = std::min(std::abs(a[2]), std::abs(b[2]));
  if (std::abs(z) > rgbd::kDepthJump * nearest) return kNone;
  return static_cast<float>(1000.0 * std::sqrt(x * x + y * y + z * z));
}

// Right, down right, down, ... counter-clockwise on paper, clockwise in the image.
constexpr int kDx[8] = {1, 1, 0, -1, -1, -1, 0, 1};
constexpr int kDy[8] = {0, 1, 1, 1, 0, -1, -1, -1};

enum Status : std::uint8_t { kFar, kAccepted, kOutside };

}  // namespace

SurfaceEdges::SurfaceEdges(const rgbd::Surface& surface, cv::Rect region, int threads)
    : region_(region) {
  const auto pixels =
      static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height);
  lengths_mm_.resize(4 * pixels);
  valid_.resize(pixels);
  parallel_for(region.height, threads, [&](int begin, int end) {
    const cv::Vec3f missing = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
    for (int y = region.y + begin; y < region.y + end; ++y) {
      const auto* here = surface.points_m.ptr<cv::Vec3f>(y);
      const auto* below =
          y + 1 < region.y + region.height ? surface.points_m.ptr<cv::Vec3f>(y + 1) : nullptr;
      for (int x = region.x; x < region.x + region.width; ++x) {
        const bool inside = x + 1 < region.x + region.width;
        const cv::Vec3f a = here[x], b = inside ? here[x + 1] : missing;
        const cv::Vec3f c = below ? below[x] : missing,
                        d = below && inside ? below[x + 1] : missing;
        float* lengths = lengths_mm_.data() + 4 * index(x, y);
        lengths[kRight] = length_mm(a, b);
        lengths[kDown] = length_mm(a, c);
        lengths[kFall] = length_mm(a, d);
        lengths[kRise] = length_mm(b, c);
        valid_[index(x, y)] = finite(a);
      }
    }
  });
}

GeodesicMarcher::GeodesicMarcher(const SurfaceEdges& edges, int patch_px)
    : edges_(edges), patch_px_(patch_px), stride_(patch_px + 2) {
  const std::ptrdiff_t row = 4 * static_cast<std::ptrdiff_t>(edges.region().width);
  for (int k = 0; k < 8; ++k) {
    local_[k] = kDy[k] * stride_ + kDx[k];
    // The edge lies with the upper left of its square.
    edge_[k] = std::min(kDx[k], 0) * std::ptrdiff_t{4} + std::min(kDy[k], 0) * row +
               (kDy[k] == 0        ? SurfaceEdges::kRight
                : kDx[k] == 0      ? SurfaceEdges::kDown
                : kDx[k] == kDy[k] ? SurfaceEdges::kFall
                                   : SurfaceEdges::kRise);
  }
  distance_.resize(static_cast<std::size_t>(stride_ * stride_));
  status_.resize(distance_.size());
}

void GeodesicMarcher::push(std::uint64_t key) {
  heap_.push_back(key);
  std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
}

std::uint64_t GeodesicMarcher::pop() {
  std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
  const std::uint64_t key = heap_.back();
  heap_.pop_back();
  return key;
}

const std::vector<GeodesicMarcher::Reached>& GeodesicMarcher::march(int x, int y, float max_mm) {
  reached_.clear();
  heap_.clear();
  const cv::Rect region = edges_.region();
  const PatchSpan all_x(x, patch_px_), all_y(y, patch_px_);
  PatchSpan span_x = all_x, span_y = all_y;
  span_x.begin = std::max(span_x.begin, region.x);
  span_y.begin = std::max(span_y.begin, region.y);
  span_x.end = std::min(span_x.end, region.x + region.width);
  span_y.end = std::min(span_y.end, region.y + region.height);
  if (x < span_x.begin || x >= span_x.end || y < span_y.begin || y >= span_y.end ||
      !edges_.valid(x, y) || !(max_mm > 0.0f)) {
    return reached_;
  }
  std::fill(status_.begin(), status_.end(), kOutside);
  for (int row = span_y.begin; row < span_y.end; ++row) {
    const std::ptrdiff_t first = (row - all_y.begin + 1) * stride_ - all_x.begin + 1;
    std::fill(status_.begin() + first + span_x.begin, status_.begin() + first + span_x.end, kFar);
  }
  std::fill(distance_.begin(), distance_.end(), kNone);

  const float* lengths = edges_.lengths_mm();
  const auto start =
      static_cast<std::size_t>((y - all_y.begin + 1) * stride_ + x - all_x.begin + 1);
  distance_[start] = 0.0f;
  push(start);
  while (!heap_.empty()) {
    // Distances are not negative, so that as integers they compare as they do as numbers.
    const std::uint64_t key = pop();
    const auto at = static_cast<std::size_t>(key & 0xffffffffu);
    if (status_[at] == kAccepted) continue;
    status_[at] = kAccepted;
    const float distance = distance_[at];
    const auto local_y = static_cast<int>(static_cast<std::ptrdiff_t>(at) / stride_);
    const auto local_x = static_cast<int>(static_cast<std::ptrdiff_t>(at) % stride_);
    const int at_x = all_x.begin + local_x - 1, at_y = all_y.begin + local_y - 1;
    reached_.push_back({at_x, at_y, distance});
    const auto edge = 4 * edges_.index(at_x, at_y);
    for (int k = 0; k < 8; ++k) {
      const auto next = at + static_cast<std::size_t>(local_[k]);
      if (status_[next] != kFar) continue;
      const float along = lengths[edge + static_cast<std::size_t>(edge_[k])];
      if (along == kNone) continue;
      const float tried = std::min(distance + along, through_triangles(at, edge, k, distance));
      if (!(tried < distance_[next]) || !(tried < max_mm)) continue;
      distance_[next] = tried;
      push(static_cast<std::uint64_t>(std::bit_cast<std::uint32_t>(tried)) << 32 | next);
    }
  }
  return reached_;
}

// The point in `direction`, C, from A, just accepted, and either B that makes a triangle with them
// whose angle in C is one of 45 degrees on a plane.
float GeodesicMarcher::through_triangles(std::size_t at, std::size_t edge, int direction,
                                         float distance) const {
  const float* lengths = edges_.lengths_mm();
  const float ca = lengths[edge + static_cast<std::size_t>(edge_[direction])];
  const float aa = ca * ca, ta = distance * distance;
  const std::ptrdiff_t row = 4 * static_cast<std::ptrdiff_t>(edges_.region().width);
  const auto edge_c = static_cast<std::ptrdiff_t>(edge) + 4 * kDx[direction] + row * kDy[direction];
  float best = kNone;
  const int step = direction % 2 == 0 ? 2 : 1;  // B is beside A along the image's axes
  for (const int side : {-1, 1}) {
    const int to_b = (direction + side * step) & 7;
    const auto b = at + static_cast<std::size_t>(local_[to_b]);
    if (status_[b] != kAccepted) continue;
    const float ab = lengths[edge + static_cast<std::size_t>(edge_[to_b])];
    // From C, A is opposite and B one step from it.
    const int c_to_b = (direction + 4 - side) & 7;
    const float cb = lengths[edge_c + edge_[c_to_b]];
    if (ab == kNone || cb == kNone) continue;
    // In the triangle's plane, A in the origin, B at (|AB|, 0), C above and the source below the
    // line AB; all times |AB|.
    const float base = ab * ab, tb = distance_[b] * distance_[b];
    const float c_x = 0.5f * (aa - cb * cb + base), s_x = 0.5f * (ta - tb + base);
    const float c_y2 = aa * base - c_x * c_x, s_y2 = ta * base - s_x * s_x;
    if (!(c_y2 > 0.0f) || !(s_y2 >= 0.0f)) continue;
    const float c_y = std::sqrt(c_y2), s_y = std::sqrt(s_y2);
    // Where the line from the source to C crosses AB.
    const float crossing = c_x * s_y + s_x * c_y;
    if (!(crossing >= 0.0f) || !(crossing <= base * (c_y + s_y))) continue;
    const float dx = c_x - s_x, dy = c_y + s_y;
    const float through = std::sqrt((dx * dx + dy * dy) / base);
    if (through >= distance) best = std::min(best, through);
  }
  return best;
}

}  // namespace weft::descriptor
