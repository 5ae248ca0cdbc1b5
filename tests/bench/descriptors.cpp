// Times dense SIFT against VLFeat's flat-window dsift on the same images in the same run, and the
// assignment of visual words.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/random.hpp"
#include "bovw/vocabulary.hpp"
#include "descriptor/sift.hpp"
#ifdef WEFT_HAVE_VLFEAT
extern "C" {
#include <vl/dsift.h>
}
#endif

namespace {

using weft::descriptor::SiftDescriptor;
using weft::descriptor::SiftOptions;

double now_ms(clockid_t clock) {
  timespec time;
  clock_gettime(clock, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

// With one thread, its CPU time: on a machine that others use too, waiting is not part of the work.
// With more, what passes on the clock.
double ms_of(int threads, const std::function<void()>& body) {
  const clockid_t clock = threads == 1 ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC;
  const double start = now_ms(clock);
  body();
  return now_ms(clock) - start;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Waves, stripes and noise at 640x480.
cv::Mat pattern() {
  weft::Random random(1);
  cv::Mat image(480, 640, CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      double value = 120 + 3 * random.normal() + 40 * std::sin(0.05 * x + 0.11 * y) +
                     30 * std::sin(0.21 * x - 0.03 * y) + ((x + 2 * y) % 41 < 13 ? -30 : 0);
      value = std::clamp(value, 0.0, 255.0);
      image.at<cv::Vec3b>(y, x) = cv::Vec3b::all(static_cast<std::uint8_t>(value));
    }
  }
  return image;
}

nlohmann::json bench_image(const cv::Mat& image, int bin_px, int runs, int threads) {
  SiftOptions options;
  options.bin_px = bin_px;
  options.presmooth = false;  // as the peer
  options.contrast_threshold = 0.0;
  const SiftDescriptor sift(options);
  const SiftDescriptor baseline(options, weft::SimdPath::kBaseline);
  options.presmooth = true;
  const SiftDescriptor smoothed(options);
  const weft::descriptor::Grid grid{3 * bin_px / 2, 3 * bin_px / 2, 6,
                                    (image.cols - 1 - 3 * bin_px) / 6 + 1,
                                    (image.rows - 1 - 3 * bin_px) / 6 + 1};
  const cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  weft::descriptor::DescriptorField field;
  std::vector<double> ours, ours_baseline, ours_smoothed, theirs, words;
#ifdef WEFT_HAVE_VLFEAT
  std::vector<float> grey;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const auto p = image.at<cv::Vec3b>(y, x);
      grey.push_back(static_cast<float>((29 * p[0] + 150 * p[1] + 77 * p[2] + 128) >> 8) / 255.0f);
    }
  }
  VlDsiftFilter* filter = vl_dsift_new_basic(image.cols, image.rows, 6, bin_px);
  vl_dsift_set_flat_window(filter, VL_TRUE);
#endif
  weft::Random random(2);
  for (int run = 0; run < runs; ++run) {
    ours.push_back(
        ms_of(threads, [&] { field = sift.describe_image(image, mask, grid, threads); }));
    ours_baseline.push_back(
        ms_of(threads, [&] { baseline.describe_image(image, mask, grid, threads); }));
    ours_smoothed.push_back(
        ms_of(threads, [&] { smoothed.describe_image(image, mask, grid, threads); }));
#ifdef WEFT_HAVE_VLFEAT
    theirs.push_back(ms_of(threads, [&] { vl_dsift_process(filter, grey.data()); }));
#endif
  }
  nlohmann::json result = {{"points", field.points.size()},
                           {"ms", median(ours)},
                           {"ms_baseline_simd", median(ours_baseline)},
                           {"ms_presmoothed", median(ours_smoothed)},
                           {"bin_px", bin_px},
                           {"threads", threads}};
  std::vector<std::uint8_t> centres;
  for (int word = 0; word < 128; ++word) {
    const auto at = random.below(field.points.size()) * 128;
    centres.insert(centres.end(), field.values.begin() + static_cast<std::ptrdiff_t>(at),
                   field.values.begin() + static_cast<std::ptrdiff_t>(at) + 128);
  }
  const weft::bovw::Vocabulary vocabulary("sift", 128, centres, 0, "");
  std::vector<std::int16_t> assigned(field.points.size());
  for (int run = 0; run < runs; ++run)
    words.push_back(ms_of(threads, [&] { vocabulary.assign(field.values, assigned, threads); }));
  result["ms_words_128"] = median(words);
  const weft::bovw::Nearest nearest(centres, 128, weft::SimdPath::kBaseline);
  std::vector<std::int32_t> found(assigned.size());
  words.clear();
  for (int run = 0; run < runs; ++run)
    words.push_back(ms_of(threads, [&] { nearest.find(field.values, found, {}); }));
  result["ms_words_128_baseline_simd"] = median(words);
#ifdef WEFT_HAVE_VLFEAT
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
  std::sort(errors.begin(), errors.end());
  result["peer"] = "VLFeat vl_dsift, flat window";
  result["peer_ms"] = median(theirs);
  result["ratio"] = median(theirs) / median(ours);
  result["mean_error"] = total / static_cast<double>(errors.size());
  result["max_error"] = errors.back();
  result["p999_error"] = errors[static_cast<std::size_t>(0.999 * double(errors.size() - 1))];
  vl_dsift_delete(filter);
#else
  result["peer"] = nullptr;
#endif
  return result;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Dense descriptors, each with its peer in the same run"};
  std::vector<std::string> images;
  std::string json;
  int runs = 15, threads = 1, bin_px = 4;
  app.add_option("images", images, "colour images; without any, a 640x480 pattern")
      ->check(CLI::ExistingFile);
  app.add_option("--runs", runs, "the median of so many runs counts")->check(CLI::Range(1, 10000));
  app.add_option("--threads", threads, "of ours; the peer has one")->check(CLI::Range(1, 64));
  app.add_option("--bin", bin_px, "spatial bin, px")->check(CLI::Range(2, 16));
  app.add_option("--json", json, "write the results here");
  CLI11_PARSE(app, argc, argv);
  nlohmann::json report;
  if (images.empty()) report["pattern"]["sift"] = bench_image(pattern(), bin_px, runs, threads);
  for (const auto& path : images) {
    const cv::Mat image = cv::imread(path, cv::IMREAD_COLOR);
    if (image.empty() || image.cols < 64 || image.rows < 64) {
      std::fprintf(stderr, "%s: not an image of at least 64x64 px\n", path.c_str());
      return 1;
    }
    report[std::filesystem::path(path).stem().string()]["sift"] =
        bench_image(image, bin_px, runs, threads);
  }
  for (const auto& [scan, results] : report.items()) {
    for (const auto& [name, r] : results.items()) {
      std::printf("%-20s %-6s %6d points %8.2f ms", scan.c_str(), name.c_str(),
                  r["points"].get<int>(), r["ms"].get<double>());
      if (r.contains("ratio")) {
        std::printf("   %s %8.2f ms   %5.2fx   mean difference %.2f %%",
                    r["peer"].get<std::string>().c_str(), r["peer_ms"].get<double>(),
                    r["ratio"].get<double>(), 100 * r["mean_error"].get<double>());
      }
      std::printf(
          "\n%27s without AVX2 %.2f ms; presmoothed %.2f ms; 128 words %.2f ms, without AVX2 %.2f "
          "ms\n",
          "", r["ms_baseline_simd"].get<double>(), r["ms_presmoothed"].get<double>(),
          r["ms_words_128"].get<double>(), r["ms_words_128_baseline_simd"].get<double>());
    }
  }
  if (!json.empty()) {
    std::ofstream file(json);
    file << report.dump(2) << "\n";
    if (!file.flush()) {
      std::fprintf(stderr, "%s: cannot write\n", json.c_str());
      return 1;
    }
  }
  return 0;
}
