#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "descriptor/dense_descriptor.hpp"
#include "rgbd/surface.hpp"

/// What the descriptors of a surface share: which points they describe, and their field.
namespace weft::descriptor {

/// The descriptors of a grid at full precision; the members are those of DescriptorField.
struct FloatField {
  Grid grid;
  int dimension = 0;
  std::vector<PointState> state;
  std::vector<std::int32_t> points;
  std::vector<float> values;
};

/// Cells of the grid points inside the mask, ascending. Throws Error starting with `where` when
/// surface, mask (CV_8UC1) and grid do not fit each other.
std::vector<std::int32_t> masked_cells(const rgbd::Surface& surface, const cv::Mat& mask,
                                       const Grid& grid, const std::string& where);

/// The field, in floats or in bytes, of `cells`, each with `dimension` values, of which
/// `described` says which count.
template <class Field = FloatField>
Field make_field(const Grid& grid, int dimension, const std::vector<std::int32_t>& cells,
                 const std::vector<std::uint8_t>& described, decltype(Field::values) values);

/// The field in 8 bit: min(255, round(scaled(v))) of each value.
template <class Scaled>
DescriptorField to_bytes(FloatField field, Scaled scaled) {
  DescriptorField out{
      field.grid, field.dimension, std::move(field.state), std::move(field.points), {}};
  out.values.reserve(field.values.size());
  for (const float v : field.values)
    out.values.push_back(static_cast<std::uint8_t>(std::min(255.0f, scaled(v) + 0.5f)));
  return out;
}

/// Side in view px of a patch: px in the sensor view, mm at the table's scale in the rectified one.
/// At least 3. Throws Error when the view's scale makes it larger than 512 px.
int patch_size_px(const rgbd::View& view, int patch_px, double patch_mm);

/// The patch's pixels along one axis around its centre's coordinate; an even one has one pixel more
/// before the centre than after it.
struct PatchSpan {
  int begin = 0, end = 0;
  PatchSpan(int centre, int size) : begin(centre - size / 2), end(begin + size) {}
  void clip(int image_size) {
    begin = begin < 0 ? 0 : begin;
    end = end > image_size ? image_size : end;
  }
};

/// Smallest rectangle that holds the clipped patches of all cells.
cv::Rect patches_region(const Grid& grid, const std::vector<std::int32_t>& cells, int patch_px,
                        cv::Size image);

}  // namespace weft::descriptor
