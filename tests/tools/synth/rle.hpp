#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace weft::test {

/// Reads COCO's compressed run lengths: the inverse of what the library writes, on its own.
inline cv::Mat decode_rle(const std::string& text, int rows, int columns) {
  std::vector<long> runs;
  for (std::size_t i = 0; i < text.size();) {
    long value = 0;
    int shift = 0;
    for (bool more = true; more;) {
      const long c = text.at(i++) - 48;
      value += (c & 0x1f) * (1L << shift);
      shift += 5;
      more = (c & 0x20) != 0;
      if (!more && (c & 0x10) != 0) value -= 1L << shift;
    }
    if (runs.size() > 2) value += runs[runs.size() - 2];
    runs.push_back(value);
  }
  cv::Mat mask(rows, columns, CV_8UC1, cv::Scalar(0));
  long at = 0;
  bool on = false;
  for (const long run : runs) {
    for (long k = 0; k < run; ++k, ++at) {
      if (on) mask.at<std::uint8_t>(static_cast<int>(at % rows), static_cast<int>(at / rows)) = 255;
    }
    on = !on;
  }
  return mask;
}

}  // namespace weft::test
