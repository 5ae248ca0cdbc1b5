// Dense SIFT beside VLFeat's flat-window dsift at equal geometry.
#include "descriptor/sift.hpp"

#include <cmath>

#include "bench/descriptors/bench.hpp"
#ifdef WEFT_HAVE_VLFEAT
extern "C" {
#include <vl/dsift.h>
}
#endif

namespace weft::bench {

nlohmann::json bench_sift(const Scan& scan, const Settings& settings) {
  const cv::Mat& image = scan.frame.colour;
  if (image.empty()) return nullptr;
  descriptor::SiftOptions options;
  const int bin_px = options.bin_px;
  const descriptor::SiftDescriptor smoothed(options);
  options.presmooth = false;  // as the peer
  options.contrast_threshold = 0.0;
  const descriptor::SiftDescriptor sift(options);
  const descriptor::SiftDescriptor baseline(options, SimdPath::kBaseline);
  const descriptor::Grid grid{3 * bin_px / 2, 3 * bin_px / 2, 6,
                              (image.cols - 1 - 3 * bin_px) / 6 + 1,
                              (image.rows - 1 - 3 * bin_px) / 6 + 1};
  const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  const auto ms = [&](const descriptor::SiftDescriptor& each) {
    return best_ms(settings.runs, settings.threads,
                   [&] { each.describe_image(image, mask, grid, settings.threads); });
  };
  const auto field = sift.describe_image(image, mask, grid, settings.threads);
  auto result = figures(field.points.size(), ms(sift), settings.threads);
  result["ms_baseline_simd"] = ms(baseline);
  result["ms_presmoothed"] = ms(smoothed);
#ifdef WEFT_HAVE_VLFEAT
  if (settings.peer) {
    std::vector<float> grey;
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const auto p = image.at<cv::Vec3b>(y, x);
        grey.push_back(static_cast<float>((29 * p[0] + 150 * p[1] + 77 * p[2] + 128) >> 8) /
                       255.0f);
      }
    }
    VlDsiftFilter* filter = vl_dsift_new_basic(image.cols, image.rows, 6, bin_px);
    vl_dsift_set_flat_window(filter, VL_TRUE);
    const double peer_ms =
        best_ms(settings.runs, 1, [&] { vl_dsift_process(filter, grey.data()); });
    // Relative difference of each descriptor; without contrast there is nothing to compare.
    const float* reference = vl_dsift_get_descriptors(filter);
    std::vector<double> errors;
    double total = 0.0;
    for (std::size_t i = 0; i < field.points.size(); ++i) {
      const auto cell = static_cast<std::size_t>(field.points[i]);
      double difference = 0.0, norm = 0.0;
      for (std::size_t k = 0; k < 128; ++k) {
        const double expected = std::min(255.0, 512.0 * double(reference[cell * 128 + k]));
        difference += std::pow(field.values[i * 128 + k] - expected, 2);
        norm += expected * expected;
      }
      if (norm == 0.0) continue;
      errors.push_back(std::sqrt(difference / norm));
      total += errors.back();
    }
    vl_dsift_delete(filter);
    result["peer"] = "VLFeat vl_dsift, flat window, one thread";
    result["peer_ms"] = peer_ms;
    result["ratio"] = peer_ms / result["ms"].get<double>();
    result["mean_error"] = total / static_cast<double>(errors.size());
    set_errors(result, std::move(errors));
  }
#endif
  return result;
}

}  // namespace weft::bench
