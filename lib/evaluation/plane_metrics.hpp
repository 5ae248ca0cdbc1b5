#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "rgbd/frame.hpp"

/// How well plane segments agree with labelled ones.
namespace weft::evaluation {

struct PlaneMatch {
  int truth = 0;     // label in the truth
  int segment = 0;   // label of the segment that overlaps it most; 0: none does
  int truth_px = 0;  // pixels of the truth
  double iou = 0.0;  // intersection over union of the two
};

struct PlaneSegmentation {
  int truths = 0;                   // labelled planes that count
  int segments = 0;                 // segments that count
  int matched = 0;                  // pairs with an IoU of min_iou or more
  double precision = 0.0;           // matched / segments
  double recall = 0.0;              // matched / truths
  double mean_iou = 0.0;            // of each truth with the segment that fits it best
  double area_iou = 0.0;            // the same, weighted by the truths' pixels
  std::vector<PlaneMatch> matches;  // one a truth that counts
};

/// labels, truth: CV_8UC1 of one size, 0 = none. Pixels without depth (where has_depth is 0) belong
/// to none on both sides: no segmentation of the depth could label them. Labelled planes of fewer
/// than min_px pixels do not count, nor do segments most of whose pixels lie on one of them: those
/// are neither right nor wrong. min_iou of more than one half makes the
/// pairs unique. Throws Error when the sizes differ or min_iou is not within 0.5 to 1.
PlaneSegmentation evaluate_segmentation(const cv::Mat& labels, const cv::Mat& truth,
                                        const cv::Mat& has_depth, double min_iou, int min_px);

/// The plane through the labelled pixels of a depth image without noise: least squares of the
/// points' distances, then of those within 3 times its rms and 5 mm, twice (a mask's border takes
/// in strangers). Throws Error for fewer than three pixels.
rgbd::Plane fit_plane(const rgbd::RgbdFrame& frame, const cv::Mat& mask);

}  // namespace weft::evaluation
