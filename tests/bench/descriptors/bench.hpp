#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "bench/timing.hpp"
#include "descriptor/dense_descriptor.hpp"
#include "rgbd/view.hpp"

/// What the benchmarks of the dense descriptors share. Each descriptor has a file of its own with
/// one function from a scan to its figures; main.cpp lists them.
namespace weft::bench {

struct Scan {
  std::string name;
  rgbd::RgbdFrame frame;  // colour is empty when the scan has none
  rgbd::View view;        // the sensor's own
  rgbd::ViewImages images;
  descriptor::Grid grid;  // step 6
};

struct Settings {
  int runs = 5;     // the fastest counts; a peer that takes seconds may run once
  int threads = 1;  // of ours, and of the peer if it has any
  bool peer = true;
};

/// A rectangle in the middle that covers this share of the image. CV_8UC1.
cv::Mat centred_mask(cv::Size size, double share);

/// How the cost grows with the mask: for 1 % to the whole view, on one thread and on two,
/// {"share", "points", "ms_1_thread", "ms_2_threads", "cpu_ms_2_threads"}; the last tells what two
/// threads cost where others keep the clock of the one before busy.
nlohmann::json cost_by_mask(const descriptor::DenseDescriptor& descriptor, const Scan& scan,
                            int runs);

/// The figures every descriptor reports, those of the peer left to fill in.
inline nlohmann::json figures(std::size_t points, double ms, int threads) {
  return {{"points", points},      {"ms", ms},          {"peer", nullptr},
          {"peer_ms", nullptr},    {"ratio", nullptr},  {"max_error", nullptr},
          {"p999_error", nullptr}, {"threads", threads}};
}
/// Greatest and 99.9th percentile of the errors, into figures.
void set_errors(nlohmann::json& figures, std::vector<double> errors);

/// Each returns null where the scan has nothing for it.
nlohmann::json bench_finddd(const Scan& scan, const Settings& settings);
nlohmann::json bench_fpfh(const Scan& scan, const Settings& settings);
nlohmann::json bench_gdh(const Scan& scan, const Settings& settings);
nlohmann::json bench_hks(const Scan& scan, const Settings& settings);
nlohmann::json bench_sift(const Scan& scan, const Settings& settings);
nlohmann::json bench_words(const Scan& scan, const Settings& settings);

}  // namespace weft::bench
