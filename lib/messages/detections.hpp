#pragma once

#include <vector>

#include "detector/types.hpp"
#include "weft/part_detections_t.hpp"

/// PART_DETECTIONS to and from the detector's types.
namespace weft::messages {

struct DetectionsContent {
  rgbd::View view;
  std::vector<detector::Detection> detections;
};

/// Fills in everything but header and status.
void to_message(const rgbd::View& view, const std::vector<detector::Detection>& detections,
                std::uint64_t model_hash, part_detections_t& message);

/// Throws stage::InvalidInput for unknown parts, probabilities outside 0 to 1, boxes without an
/// area and numbers that are not finite.
DetectionsContent from_message(const part_detections_t& message);

}  // namespace weft::messages
