#include "bench/descriptors/bench.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

namespace weft::bench {
cv::Mat centred_mask(cv::Size size, double share) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  const int width = static_cast<int>(std::lround(size.width * std::sqrt(share)));
  const int height = static_cast<int>(std::lround(size.height * std::sqrt(share)));
  mask(cv::Rect((size.width - width) / 2, (size.height - height) / 2, width, height)) = 255;
  return mask;
}

nlohmann::json cost_by_mask(const descriptor::DenseDescriptor& descriptor, const Scan& scan,
                            int runs) {
  auto rows = nlohmann::json::array();
  for (const double share : {0.01, 0.1, 1.0 / 3, 1.0}) {
    rgbd::ViewImages images = scan.images;
    images.mask = centred_mask(images.mask.size(), share);
    std::size_t points = 0;
    const auto ms = [&](int threads) {
      return best_ms(runs, threads, [&] {
        points =
            descriptor.describe(scan.frame, scan.view, images, scan.grid, threads).points.size();
      });
    };
    const double one = ms(1), two = ms(2);
    const double cpu =
        best_ms(runs, 1, [&] { descriptor.describe(scan.frame, scan.view, images, scan.grid, 2); });
    rows.push_back({{"share", share},
                    {"points", points},
                    {"ms_1_thread", one},
                    {"ms_2_threads", two},
                    {"cpu_ms_2_threads", cpu}});
  }
  return rows;
}

void set_errors(nlohmann::json& figures, std::vector<double> errors) {
  if (errors.empty()) return;
  std::sort(errors.begin(), errors.end());
  figures["max_error"] = errors.back();
  figures["p999_error"] = errors[static_cast<std::size_t>(0.999 * double(errors.size() - 1))];
}

}  // namespace weft::bench
