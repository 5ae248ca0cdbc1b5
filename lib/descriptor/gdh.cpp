#include "descriptor/gdh.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/parallel.hpp"
#include "descriptor/geodesic.hpp"

namespace weft::descriptor {

GdhDescriptor::GdhDescriptor(const GdhOptions& options) : options_(options) { options_.validate(); }

const std::string& GdhDescriptor::name() const {
  static const std::string name = "gdh";
  return name;
}

DescriptorField GdhDescriptor::describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                                        const rgbd::ViewImages& images, const Grid& grid,
                                        int threads) const {
  return to_bytes(
      describe_surface(rgbd::render_surface(frame, view), images.mask, grid,
                       patch_size_px(view, options_.patch_px, options_.patch_mm), threads),
      [](float v) { return 512.0f * v; });
}

FloatField GdhDescriptor::describe_surface(const rgbd::Surface& surface, const cv::Mat& mask,
                                           const Grid& grid, int patch_px, int threads) const {
  const auto cells = masked_cells(surface, mask, grid, "GDH");
  const SurfaceEdges edges(surface, patches_region(grid, cells, patch_px, surface.points_m.size()),
                           threads);
  const auto size = static_cast<std::size_t>(dimension());
  const auto max_mm = static_cast<float>(options_.geodesic_max_mm);
  const float to_geodesic_bin = static_cast<float>(options_.geodesic_bins) / max_mm;
  const auto range_mm = static_cast<float>(options_.depth_range_mm);
  const float to_depth_bin = static_cast<float>(options_.depth_bins) / (2.0f * range_mm);
  std::vector<float> values(cells.size() * size);
  std::vector<std::uint8_t> described(cells.size());
  parallel_for(static_cast<int>(cells.size()), threads, [&](int begin, int end) {
    GeodesicMarcher marcher(edges, patch_px);
    for (int i = begin; i < end; ++i) {
      const int cell = cells[static_cast<std::size_t>(i)];
      const int x = grid.x(cell % grid.columns), y = grid.y(cell / grid.columns);
      const auto& reached = marcher.march(x, y, max_mm);
      if (static_cast<int>(reached.size()) < options_.min_points) continue;
      described[static_cast<std::size_t>(i)] = 1;
      float* histogram = values.data() + static_cast<std::size_t>(i) * size;
      const float centre_m = surface.points_m.ptr<cv::Vec3f>(y)[x][2];
      for (const auto& point : reached) {
        const float depth_mm =
            1000.0f * (surface.points_m.ptr<cv::Vec3f>(point.y)[point.x][2] - centre_m);
        const int geodesic = std::min(static_cast<int>(point.distance_mm * to_geodesic_bin),
                                      options_.geodesic_bins - 1);
        const float place = std::clamp((depth_mm + range_mm) * to_depth_bin, 0.0f,
                                       static_cast<float>(options_.depth_bins));
        const int depth = std::min(static_cast<int>(place), options_.depth_bins - 1);
        histogram[geodesic * options_.depth_bins + depth] += 1.0f;
      }
      float squares = 0.0f;
      for (int bin = 0; bin < options_.geodesic_bins; ++bin) {
        float* column = histogram + bin * options_.depth_bins;
        float votes = 0.0f;
        for (int k = 0; k < options_.depth_bins; ++k) votes += column[k];
        if (votes == 0.0f) continue;
        for (int k = 0; k < options_.depth_bins; ++k) {
          column[k] /= votes;
          squares += column[k] * column[k];
        }
      }
      const float norm = std::sqrt(squares);
      for (std::size_t k = 0; k < size; ++k) histogram[k] /= norm;
    }
  });
  return make_field(grid, dimension(), cells, described, std::move(values));
}

}  // namespace weft::descriptor
