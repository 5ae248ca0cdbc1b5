#include "bench/descriptors/bench.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <opencv2/core.hpp>

namespace weft::bench {
namespace {

double now_ms(clockid_t clock) {
  timespec time;
  clock_gettime(clock, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

}  // namespace

double ms_of(int threads, const std::function<void()>& body) {
  const clockid_t clock = threads == 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC;
  const double start = now_ms(clock);
  body();
  return now_ms(clock) - start;
}

double best_ms(int runs, int threads, const std::function<void()>& body) {
  double best = std::numeric_limits<double>::infinity();
  for (int run = 0; run < runs; ++run) best = std::min(best, ms_of(threads, body));
  return best;
}

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
    rows.push_back(
        {{"share", share}, {"points", points}, {"ms_1_thread", one}, {"ms_2_threads", two}});
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
