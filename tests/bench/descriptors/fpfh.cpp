// FPFH of every grid point beside PCL's FPFHEstimationOMP, given the same normals and points.
#include "descriptor/fpfh.hpp"

#include "bench/descriptors/bench.hpp"
#include "support/pcl_fpfh.hpp"

namespace weft::bench {

nlohmann::json bench_fpfh(const Scan& scan, const Settings& settings) {
  descriptor::FpfhOptions options;
  const descriptor::FpfhDescriptor whole(options);
  options.min_neighbours = 1;  // as the peer
  const descriptor::FpfhDescriptor fpfh(options);
  const descriptor::FpfhDescriptor baseline(options, SimdPath::kBaseline);
  const auto surface = rgbd::render_surface(scan.frame, scan.view);
  const auto normals = rgbd::estimate_normals(surface, options.normals, settings.threads);
  const cv::Mat& mask = scan.images.mask;
  const auto describe = [&](const descriptor::FpfhDescriptor& each) {
    return each.describe_surface(surface, normals, mask, scan.grid, settings.threads);
  };
  const auto ms = [&](const descriptor::FpfhDescriptor& each) {
    return best_ms(settings.runs, settings.threads, [&] { describe(each); });
  };
  const auto field = describe(fpfh);
  auto result = figures(field.points.size(), ms(fpfh), settings.threads);
  result["ms_baseline_simd"] = ms(baseline);
  result["ms_with_normals"] = best_ms(settings.runs, settings.threads, [&] {
    whole.describe(scan.frame, scan.view, scan.images, scan.grid, settings.threads);
  });
  result["cost"] = cost_by_mask(whole, scan, settings.runs);
  if (!settings.peer || field.points.empty()) return result;
  std::vector<int> indices;
  for (const int cell : field.points) {
    indices.push_back(scan.grid.y(cell / scan.grid.columns) * surface.points_m.cols +
                      scan.grid.x(cell % scan.grid.columns));
  }
  test::PclFpfh pcl(surface, normals, options.radius_m, settings.threads);
  std::vector<float> theirs;
  const auto run_peer = [&] { theirs = pcl.of(indices); };
  double peer_ms = ms_of(settings.threads, run_peer);  // up to half a minute: once
  if (peer_ms < 3000.0) peer_ms = std::min(peer_ms, best_ms(2, settings.threads, run_peer));
  std::vector<double> errors;
  for (std::size_t i = 0; i < theirs.size(); ++i)
    errors.push_back(std::abs(double{theirs[i]} - field.values[i]));
  result["peer"] = "PCL FPFHEstimationOMP, as many threads, its fastest search";
  result["peer_ms"] = peer_ms;
  result["ratio"] = peer_ms / result["ms"].get<double>();
  set_errors(result, std::move(errors));
  return result;
}

}  // namespace weft::bench
