#pragma once

#include <opencv2/core/mat.hpp>
#include <span>
#include <vector>

#include "base/options.hpp"
#include "detector/types.hpp"
#include "foreground/pieces.hpp"
#include "rgbd/frame.hpp"
#include "slam/garment_map.hpp"

/// What a frame's foreground, detections and grasps say of garments, as the map takes it in.
namespace weft::map_process {

struct SightingOptions {
  double least_probability = 0.1;
  double most_extent_m = 0.8;
  double sigma_px = 6.0;
  foreground::PieceOptions pieces;

  void visit(OptionVisitor& v) {
    v.field("least_probability", least_probability, {0.0, 1.0}, "",
            "of the detections that are carried into the map");
    v.field("most_extent_m", most_extent_m, {0.0, 100.0}, "m",
            "half the largest size of a garment; larger pieces of the foreground are none, such as "
            "furniture");
    v.field("sigma_px", sigma_px, {0.1, 100.0}, "px",
            "standard deviation of a part's place: the detector's grid");
    v.group("pieces", pieces);
  }
  void validate() const { validate_fields(*this, "SightingOptions"); }
};

/// Each piece of the mask of a garment's size is one (foreground/pieces.hpp). A detection belongs
/// to the piece at its centre; its part lies where its grasp is, or else at the centre's depth; a
/// centre off the cloth, or without depth, leaves it out. Where the cloth is steep, an error in the
/// picture is one in depth too: the covariance lies along the cloth. frame: with depth. mask:
/// CV_8UC1, its size.
std::vector<slam::GarmentSighting> sight_garments(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                                                  std::span<const detector::Detection> detections,
                                                  std::span<const detector::Grasp> grasps,
                                                  const SightingOptions& options);

}  // namespace weft::map_process
