#pragma once

#include <opencv2/core/mat.hpp>

#include "base/options.hpp"
#include "rgbd/frame.hpp"

/// Garments of a mask, told apart by its shape and depth alone.
namespace weft::foreground {

struct PieceOptions {
  double neck_m = 0.03;
  double step_m = 0.02;
  double inverse_depth_per_m = 0.003;
  double least_extent_m = 0.05;

  void visit(OptionVisitor& v) {
    v.field("neck_m", neck_m, {0.0, 1.0}, "m",
            "what hangs together by less than this is two garments that touch, or one before "
            "another; a sleeve is wider");
    v.field("step_m", step_m, {0.0, 10.0}, "m",
            "a step in depth between neighbouring pixels by more than this, and three standard "
            "deviations, parts two garments");
    v.field("inverse_depth_per_m", inverse_depth_per_m, {0.0, 0.1}, "1/m",
            "standard deviation of inverse depth, times z^2 that of depth");
    v.field("least_extent_m", least_extent_m, {0.0, 10.0}, "m",
            "half the largest size of a garment: what is smaller belongs to its neighbour");
  }
  void validate() const { validate_fields(*this, "PieceOptions"); }
};

struct Pieces {
  cv::Mat labels;  // CV_32SC1, the mask's size: 0 outside it, else 1 + index of the piece
  int count = 0;
};

/// Parts a mask (CV_8UC1, the frame's size) at steps in depth and at necks. Each pixel of the mask
/// is of one piece; those without depth go with what is nearest along the mask. In order of their
/// first pixels, by rows. Throws Error on a mask of another size or type. Class A.
Pieces part_mask(const rgbd::RgbdFrame& frame, const cv::Mat& mask, const PieceOptions& options);

}  // namespace weft::foreground
