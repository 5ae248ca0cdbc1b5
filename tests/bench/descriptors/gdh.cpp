// GDH beside the same marching without a heap, in double precision. There is no public peer: the
// paper's ran for 6826 s a scan.
#include "descriptor/gdh.hpp"

#include "bench/descriptors/bench.hpp"
#include "support/slow_marching.hpp"

namespace weft::bench {

nlohmann::json bench_gdh(const Scan& scan, const Settings& settings) {
  descriptor::GdhOptions options;
  const descriptor::GdhDescriptor gdh(options);
  rgbd::ViewImages images = scan.images;
  images.mask = centred_mask(images.mask.size(), 1.0 / 3);  // the goal's garment
  descriptor::DescriptorField field;
  const double ms = best_ms(settings.runs, settings.threads, [&] {
    field = gdh.describe(scan.frame, scan.view, images, scan.grid, settings.threads);
  });
  auto result = figures(field.points.size(), ms, settings.threads);
  result["cost"] = cost_by_mask(gdh, scan, settings.runs);
  if (!settings.peer || field.points.empty()) return result;
  // The reference on some points, its time for all of them in proportion.
  const auto surface = rgbd::render_surface(scan.frame, scan.view);
  const auto floats = gdh.describe_surface(surface, images.mask, scan.grid, options.patch_px, 1);
  const std::size_t every = std::max<std::size_t>(1, field.points.size() / 40);
  std::vector<double> errors;
  double peer_ms = 0.0;
  int ties = 0, compared = 0;
  for (std::size_t i = 0; i < field.points.size(); i += every, ++compared) {
    const int cell = field.points[i];
    test::SlowHistogram slow;
    peer_ms += ms_of(1, [&] {
      slow = test::slow_histogram(surface, scan.grid.x(cell % scan.grid.columns),
                                  scan.grid.y(cell / scan.grid.columns), options.patch_px, options);
    });
    ties += slow.tie;
    for (std::size_t k = 0; k < slow.values.size() && !slow.tie; ++k)
      errors.push_back(
          std::abs(slow.values[k] - double{floats.values[i * slow.values.size() + k]}));
  }
  result["peer"] = "fast marching without a heap, one thread, from a sample";
  result["peer_ms"] = peer_ms * static_cast<double>(field.points.size()) / compared;
  result["ratio"] = result["peer_ms"].get<double>() / ms;
  result["compared"] = compared;
  result["ties_left_out"] = ties;
  set_errors(result, std::move(errors));
  return result;
}

}  // namespace weft::bench
