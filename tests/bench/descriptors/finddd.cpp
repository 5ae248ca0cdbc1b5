// FINDDD, its normals included, beside PCL's integral-image normals alone.
#include "descriptor/finddd.hpp"

#include <pcl/features/integral_image_normal.h>

#include <opencv2/core.hpp>

#include "bench/descriptors/bench.hpp"
#include "support/plain_finddd.hpp"

namespace weft::bench {

nlohmann::json bench_finddd(const Scan& scan, const Settings& settings) {
  const descriptor::FindddOptions options;
  const descriptor::FindddDescriptor finddd(options);
  const descriptor::FindddDescriptor baseline(options, SimdPath::kBaseline);
  const auto surface = rgbd::render_surface(scan.frame, scan.view);
  const int threads = settings.threads;
  descriptor::DescriptorField field;
  const auto ms = [&](const descriptor::FindddDescriptor& each) {
    return best_ms(settings.runs, threads, [&] {
      field =
          each.describe_surface(surface, scan.images.mask, scan.grid, options.patch_px, threads);
    });
  };
  // From a surface on, as the peer begins with a cloud.
  auto result = figures(field.points.size(), ms(finddd), threads);
  result["points"] = field.points.size();
  result["ms_baseline_simd"] = ms(baseline);
  result["ms_normals"] = best_ms(
      settings.runs, threads, [&] { rgbd::estimate_normals(surface, options.normals, threads); });
  result["ms_surface"] =
      best_ms(settings.runs, threads, [&] { rgbd::render_surface(scan.frame, scan.view); });
  result["cost"] = cost_by_mask(finddd, scan, settings.runs);
  if (!settings.peer) return result;

  const auto cloud = pcl::PointCloud<pcl::PointXYZ>::Ptr(new pcl::PointCloud<pcl::PointXYZ>(
      static_cast<std::uint32_t>(scan.view.width), static_cast<std::uint32_t>(scan.view.height)));
  cloud->is_dense = false;
  for (int y = 0; y < scan.view.height; ++y)
    for (int x = 0; x < scan.view.width; ++x) {
      const auto& p = surface.points_m.at<cv::Vec3f>(y, x);
      cloud->at(x, y) = pcl::PointXYZ(p[0], p[1], p[2]);
    }
  const double peer_ms = best_ms(settings.runs, 1, [&] {
    pcl::IntegralImageNormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
    estimation.setNormalEstimationMethod(estimation.AVERAGE_3D_GRADIENT);
    estimation.setMaxDepthChangeFactor(0.02f);
    estimation.setNormalSmoothingSize(10.0f);
    estimation.setInputCloud(cloud);
    pcl::PointCloud<pcl::Normal> normals;
    estimation.compute(normals);
  });
  result["peer"] = "PCL integral-image normals, 3D gradient, one thread";
  result["peer_ms"] = peer_ms;
  result["ratio"] = peer_ms / result["ms"].get<double>();
  result["ratio_to_peer_plus_10_ms"] = (peer_ms + 10.0) / result["ms"].get<double>();

  // Beside the definition on some points: the error of a cell's sum as a share of its pixels.
  const cv::Mat normals = rgbd::estimate_normals(surface, options.normals, threads);
  const auto sums =
      finddd.sums_of_surface(surface, scan.images.mask, scan.grid, options.patch_px, threads);
  const auto dimension = static_cast<std::size_t>(sums.dimension);
  std::vector<double> errors;
  for (std::size_t i = 0; i < sums.points.size();
       i += std::max<std::size_t>(1, sums.points.size() / 200)) {
    const int cell = sums.points[i];
    const auto plain =
        test::plain_finddd(normals, scan.grid.x(cell % scan.grid.columns),
                           scan.grid.y(cell / scan.grid.columns), options.patch_px, options);
    for (std::size_t k = 0; k < dimension; ++k)
      errors.push_back(std::abs(plain.sums[k] - sums.values[i * dimension + k]) /
                       plain.largest_cell_px);
  }
  set_errors(result, std::move(errors));
  return result;
}

}  // namespace weft::bench
