#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "dataset/scene.hpp"
#include "detector/types.hpp"

/// How well garment parts are found (papers/garment-parts.txt section 5.1).
namespace weft::evaluation {

/// An image with its truth and what was detected in it. All coordinates are sensor px.
struct JudgedImage {
  std::string name;
  std::vector<dataset::PartPolygon> truth;
  std::vector<detector::Detection> detections;  // any order
  cv::Mat mask;  // CV_8UC1, non-zero = garment, for the chance level; may be empty
};

/// One part over a set of images. A detection is right when its centre lies in a polygon of its
/// part. A centre that lies only in `ignore` polygons of the part counts neither way. Rates are
/// empty where there is nothing to divide by.
struct PartScore {
  std::string part;
  int positives = 0;        // polygons to be found
  int positive_images = 0;  // images that show at least one
  int images = 0;           // images judged, with and without the part
  int detections = 0;       // counted right or wrong
  int sure = 0;             // of these, with at least the threshold's probability
  int sure_right = 0;       // and right; several on one polygon count each
  /// Share of positive images with a right detection among the k best ones.
  std::optional<double> recall_at_1, recall_at_3, recall_at_5;
  /// Recall at one of a random point of the mask, averaged over positive images with a mask.
  std::optional<double> chance_at_1;
  /// Share of the polygons whose bounding box has its centre in a polygon of the part.
  std::optional<double> oracle_at_1;
  /// Area under the precision-recall curve over all images, each polygon found at most once and
  /// further detections of it wrong: precision made non-increasing, every recall (VOC 2010), and
  /// mean of 11 recalls (VOC 2007).
  std::optional<double> ap, ap11;
};

struct Evaluation {
  std::vector<PartScore> parts;            // in the order of detector::kParts
  double threshold = 0.5;                  // of sure detections
  std::optional<double> map;               // mean AP of the parts with positives
  std::optional<double> mean_recall_at_1;  // of the parts with positives
};

/// Scores detections. Detections of equal probability rank in the order of images and detections.
/// threshold: probability from which on a detection is counted as sure.
Evaluation evaluate_parts(const std::vector<JudgedImage>& images, double threshold = 0.5);

/// Whether a point lies in a polygon (even-odd rule) or on its border.
bool inside(const std::vector<cv::Point2f>& polygon, double x, double y);

/// Average precision from hits in rank order.
struct AveragePrecision {
  double all_points = 0.0;
  double eleven_points = 0.0;
};
AveragePrecision average_precision(const std::vector<bool>& hits, int positives);

}  // namespace weft::evaluation
