#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "base/options.hpp"
#include "rgbd/frame.hpp"
#include "slam/descriptor.hpp"

/// The front end: corners of an image with what is needed to find them again.
namespace weft::slam {

struct Feature {
  float u_px = 0.0f, v_px = 0.0f;  // in the full image
  float depth_m = 0.0f;            // along the optical axis; 0 = unknown
  float angle_deg = 0.0f;          // orientation of the patch, [0, 360)
  int level = 0;                   // of the pyramid: its patch is scale^level larger
  Descriptor descriptor{};
};

struct FeatureOptions {
  int features = 1000;
  int levels = 8;
  double scale = 1.2;
  int fast_threshold = 20;
  int low_fast_threshold = 5;
  int cell_px = 30;
  double depth_jump = 0.04;
  double max_depth_m = 8.0;

  void visit(OptionVisitor& v) {
    v.field("features", features, {50, 10000}, "", "features wanted in an image (ORB-SLAM2: 1000)");
    v.field("levels", levels, {1, 12}, "", "levels of the image pyramid");
    v.field("scale", scale, {1.05, 2.0}, "", "of a level to the next");
    v.field("fast_threshold", fast_threshold, {1, 255}, "grey levels",
            "contrast of a corner (FAST)");
    v.field("low_fast_threshold", low_fast_threshold, {1, 255}, "grey levels",
            "the same in cells that have no corner of the full contrast; ORB-SLAM2: 7, which finds "
            "three "
            "third of the features on furniture without texture");
    v.field("cell_px", cell_px, {10, 200}, "px",
            "the best corner of each cell of this size comes before the second best of any");
    v.field("depth_jump", depth_jump, {0.0, 1.0}, "",
            "a feature has no depth where depths one pixel around it differ by more than this "
            "share: there its depth is that of one of two surfaces, by chance");
    v.field("max_depth_m", max_depth_m, {0.5, 100.0}, "m", "depths beyond this are not used");
  }
  void validate() const { validate_fields(*this, "FeatureOptions"); }
};

/// ORB features spread over the image, with depth. The same bits for the same image.
class FeatureExtractor {
 public:
  explicit FeatureExtractor(const FeatureOptions& options);
  /// exclude: CV_8UC1 of the frame's size, no features where it is not 0 (things that move); may be
  /// empty. Throws Error when the images do not fit the frame's camera.
  std::vector<Feature> extract(const rgbd::RgbdFrame& frame, const cv::Mat& exclude = {}) const;

 private:
  FeatureOptions options_;
};

}  // namespace weft::slam
