#pragma once

#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

#include "descriptor/finddd.hpp"

/// FINDDD's definition, vote by vote: the oracle of its tests and benchmark.
namespace weft::test {

struct PlainFinddd {
  bool described = false;
  std::vector<double> sums;  // of votes, before any normalisation
  int largest_cell_px = 0;
};

inline PlainFinddd plain_finddd(const cv::Mat& normals, int x, int y, int patch_px,
                                const descriptor::FindddOptions& options) {
  const auto bins = descriptor::finddd_bins(options.subdivisions);
  const auto chord = [](const auto& a, const auto& b) {
    return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  };
  double radius = 2.0;
  for (const auto& a : bins)
    for (const auto& b : bins)
      if (&a != &b) radius = std::min(radius, chord(a, b));
  PlainFinddd result;
  const int cells = options.cells;
  result.sums.assign(static_cast<std::size_t>(cells * cells) * bins.size(), 0.0);
  std::vector<int> width(static_cast<std::size_t>(cells), 0);
  int with_normal = 0;
  // The cell of the i-th pixel: the last whose first pixel is not beyond it.
  const auto cell_of = [&](int i) {
    int cell = 0;
    while (cell + 1 < cells && i >= std::floor((cell + 1.0) * patch_px / cells + 0.5)) ++cell;
    return cell;
  };
  for (int i = 0; i < patch_px; ++i) ++width[static_cast<std::size_t>(cell_of(i))];
  const int widest = *std::max_element(width.begin(), width.end());
  result.largest_cell_px = widest * widest;
  for (int j = 0; j < patch_px; ++j) {
    for (int i = 0; i < patch_px; ++i) {
      const int u = x - patch_px / 2 + i, v = y - patch_px / 2 + j;
      if (u < 0 || v < 0 || u >= normals.cols || v >= normals.rows) continue;
      const auto& n = normals.at<cv::Vec3f>(v, u);
      if (std::isnan(n[0])) continue;
      ++with_normal;
      const std::array<double, 3> normal{n[0], n[1], n[2]};
      double* cell = result.sums.data() +
                     static_cast<std::size_t>(cell_of(i) + cells * cell_of(j)) * bins.size();
      std::size_t nearest = 0;
      for (std::size_t bin = 0; bin < bins.size(); ++bin) {
        const double distance = chord(normal, bins[bin]);
        if (distance < chord(normal, bins[nearest])) nearest = bin;
        if (options.soft_votes) cell[bin] += std::max(0.0, 1.0 - distance / radius);
      }
      if (!options.soft_votes) cell[nearest] += 1.0;
    }
  }
  result.described = with_normal > 0 && with_normal >= options.min_share * patch_px * patch_px;
  return result;
}

}  // namespace weft::test
