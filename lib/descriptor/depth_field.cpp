#include "descriptor/depth_field.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace weft::descriptor {

std::vector<std::int32_t> masked_cells(const rgbd::Surface& surface, const cv::Mat& mask,
                                       const Grid& grid, const std::string& where) {
  const cv::Mat& points = surface.points_m;
  if (points.empty() || points.type() != CV_32FC3)
    throw Error(where +
                ": expected a surface of three floats a point; make it with "
                "render_surface()");
  if (mask.type() != CV_8UC1 || mask.size() != points.size())
    throw Error(where + ": expected an 8-bit mask of the surface's size");
  if (grid.columns < 0 || grid.rows < 0 || grid.step_px < 1 || grid.origin_x < 0 ||
      grid.origin_y < 0 || (grid.columns > 0 && grid.x(grid.columns - 1) >= points.cols) ||
      (grid.rows > 0 && grid.y(grid.rows - 1) >= points.rows)) {
    throw Error(where + ": the grid reaches beyond the image; make it with make_grid()");
  }
  std::vector<std::int32_t> cells;
  for (int row = 0; row < grid.rows; ++row) {
    const auto* mask_row = mask.ptr<std::uint8_t>(grid.y(row));
    for (int column = 0; column < grid.columns; ++column)
      if (mask_row[grid.x(column)]) cells.push_back(row * grid.columns + column);
  }
  return cells;
}

template <class Field>
Field make_field(const Grid& grid, int dimension, const std::vector<std::int32_t>& cells,
                 const std::vector<std::uint8_t>& described, decltype(Field::values) values) {
  const auto size = static_cast<std::size_t>(dimension);
  Field field{
      grid, dimension, std::vector<PointState>(grid.cells(), PointState::kOutsideMask), {}, {}};
  for (std::size_t i = 0; i < cells.size(); ++i) {
    auto& state = field.state[static_cast<std::size_t>(cells[i])];
    state = PointState::kNothing;
    if (!described[i]) continue;
    state = PointState::kDescribed;
    if (i != field.points.size())
      std::copy_n(values.data() + i * size, size, values.data() + field.points.size() * size);
    field.points.push_back(cells[i]);
  }
  values.resize(field.points.size() * size);
  field.values = std::move(values);
  return field;
}

template FloatField make_field<FloatField>(const Grid&, int, const std::vector<std::int32_t>&,
                                           const std::vector<std::uint8_t>&, std::vector<float>);
template DescriptorField make_field<DescriptorField>(const Grid&, int,
                                                     const std::vector<std::int32_t>&,
                                                     const std::vector<std::uint8_t>&,
                                                     std::vector<std::uint8_t>);

int patch_size_px(const rgbd::View& view, int patch_px, double patch_mm) {
  if (view.kind == rgbd::View::Kind::kSensor) return patch_px;
  const double size = std::floor(patch_mm * 0.001 * view.scale_px_per_m + 0.5);
  if (!(size <= 512.0)) {
    throw Error("a patch of " + std::to_string(patch_mm) + " mm has more than 512 px at " +
                std::to_string(view.scale_px_per_m) + " px/m; take a coarser view");
  }
  return std::max(3, static_cast<int>(size));
}

cv::Rect patches_region(const Grid& grid, const std::vector<std::int32_t>& cells, int patch_px,
                        cv::Size image) {
  cv::Rect region;
  for (const int cell : cells) {
    PatchSpan x(grid.x(cell % grid.columns), patch_px), y(grid.y(cell / grid.columns), patch_px);
    x.clip(image.width);
    y.clip(image.height);
    region |= cv::Rect(x.begin, y.begin, x.end - x.begin, y.end - y.begin);
  }
  return region;
}

}  // namespace weft::descriptor
