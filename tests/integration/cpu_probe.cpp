// Which code the libraries run in this process: proof that the environment of determinism_test.cpp
// is heeded. Prints a hash of libm's results, OpenCV's instruction sets, and Weft's path.
#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include "base/hash.hpp"
#include "base/simd.hpp"

int main() {
  weft::Hash64 hash;
  for (int i = 1; i < 20000; ++i) {
    const double x = i * 1.37e-3;
    for (const double y : {std::exp(x), std::sin(x), std::pow(x, 1.7)}) hash.add(&y, sizeof y);
  }
  std::printf("libm %s opencv %d%d%d simd %s\n", weft::to_hex(hash.value()).c_str(),
              cv::checkHardwareSupport(CV_CPU_AVX2), cv::checkHardwareSupport(CV_CPU_AVX512_SKX),
              cv::checkHardwareSupport(CV_CPU_SSE4_1), weft::to_string(weft::process_simd_path()));
  return 0;
}
