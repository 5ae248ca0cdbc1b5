// HKS beside dense eigendecompositions of some patches. There is no public peer: the paper's ran
// for 20703 s a scan.
#include "descriptor/hks.hpp"

#include <algorithm>
#include <cmath>

#include "bench/descriptors/bench.hpp"
#include "support/dense_heat.hpp"

namespace weft::bench {

nlohmann::json bench_hks(const Scan& scan, const Settings& settings) {
  descriptor::HksOptions options;
  const descriptor::HksDescriptor hks(options);
  rgbd::ViewImages images = scan.images;
  images.mask = centred_mask(images.mask.size(), 1.0 / 3);  // the goal's garment
  descriptor::DescriptorField field;
  const auto ms = [&](const descriptor::HksDescriptor& each) {
    return best_ms(settings.runs, settings.threads, [&] {
      field = each.describe(scan.frame, scan.view, images, scan.grid, settings.threads);
    });
  };
  const double ours = ms(hks);
  auto result = figures(field.points.size(), ours, settings.threads);
  result["ms_baseline_simd"] = ms(descriptor::HksDescriptor(options, SimdPath::kBaseline));
  options.stride_px = 2;
  result["ms_every_second_pixel"] = ms(descriptor::HksDescriptor(options));
  options.stride_px = 1;
  result["cost"] = cost_by_mask(hks, scan, settings.runs);
  if (!settings.peer || field.points.empty()) return result;

  // The decomposition of a patch of full size takes a minute: both are timed on smaller ones.
  constexpr int kPatchPx = 40;
  const auto surface = rgbd::render_surface(scan.frame, scan.view);
  std::vector<double> errors;
  const auto compare = [&](std::size_t i, int patch_px) {
    const int cell = field.points[i];
    const cv::Point centre(scan.grid.x(cell % scan.grid.columns),
                           scan.grid.y(cell / scan.grid.columns));
    const auto fast =
        hks.describe_surface(surface, images.mask, {centre.x, centre.y, 1, 1, 1}, patch_px, 1);
    const cv::Rect patch =
        cv::Rect(centre.x - patch_px / 2, centre.y - patch_px / 2, patch_px, patch_px) &
        cv::Rect({}, surface.points_m.size());
    std::vector<double> slow;
    const double slow_ms =
        ms_of(1, [&] { slow = test::dense_hks(surface, patch, centre, options); });
    // A smaller patch may have nothing to describe.
    for (std::size_t k = 0; k < fast.values.size(); ++k)
      errors.push_back(std::abs(slow[k] - double{fast.values[k]}) / slow[0]);
    return slow_ms;
  };
  const std::size_t points = field.points.size();
  for (std::size_t i = 0; i < 12; ++i) compare(i * points / 12, 24);
  const double smaller_ms = best_ms(settings.runs, 1, [&] {
    hks.describe_surface(surface, images.mask, scan.grid, kPatchPx, 1);
  });
  result["peer"] = "dense eigendecomposition of 40 px patches, from one of them";
  result["peer_ms"] = compare(points / 2, kPatchPx) * static_cast<double>(points);
  result["ms_40_px_patches_1_thread"] = smaller_ms;
  result["ratio"] = result["peer_ms"].get<double>() / smaller_ms;
  set_errors(result, std::move(errors));
  return result;
}

}  // namespace weft::bench
