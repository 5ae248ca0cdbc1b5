#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "rgbd/frame.hpp"

namespace weft::foreground {

/// Garment mask and table plane of one frame.
struct Foreground {
  enum class Source { kLive, kDataset };
  cv::Mat mask;                      // CV_8UC1, 255 = garment, the sensor image's size
  std::optional<rgbd::Plane> table;  // camera frame; absent when none was found
  Source source = Source::kLive;
};

}  // namespace weft::foreground
