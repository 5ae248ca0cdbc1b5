#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "dataset/scene.hpp"
#include "detector/types.hpp"

namespace weft::evaluation {

/// The image with truth and detections drawn in: true polygons green (grey: to be ignored), the
/// three best detections of each part that is there, and others of at least min_probability, red to
/// black by their rank within the part, with their centres; a ring round a centre that is right.
cv::Mat draw_parts(const cv::Mat& colour, const std::vector<dataset::PartPolygon>& truth,
                   const std::vector<detector::Detection>& detections, double min_probability);

}  // namespace weft::evaluation
