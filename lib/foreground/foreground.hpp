#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "base/options.hpp"
#include "foreground/table.hpp"
#include "rgbd/frame.hpp"

namespace weft::foreground {

/// Garment mask and table plane of one frame.
struct Foreground {
  enum class Source { kLive, kDataset };
  cv::Mat mask;                      // CV_8UC1, 255 = garment, the sensor image's size
  std::optional<rgbd::Plane> table;  // camera frame; absent when none was found
  Source source = Source::kLive;
};

/// Live segmentation. Height above the table (its plane, bent by the sensor's own distortion) and a
/// colour model of garment against table vote on each cell of an image of about 320 px width; the
/// votes are averaged along what looks alike, and retrain the colour model. The outline is then
/// found at full size.
struct SegmentOptions {
  double min_height_sigma = 1.6;
  double depth_weight = 1.0;
  double colour_weight = 1.0;
  double edge_level = 12.0;
  double edge_height_sigma = 2.0;
  double reach_cells = 250.0;
  int iterations = 2;
  double min_component_cm2 = 40.0;
  double max_hole_cm2 = 2.0;
  double min_component_height_mm = 2.0;
  double max_outline_passage = 0.65;
  double min_outline_step_sigma = 1.2;

  void visit(OptionVisitor& v) {
    v.field("min_height_sigma", min_height_sigma, {0.0, 20.0}, "",
            "height that speaks neither for cloth nor table, in units of the table's own noise");
    v.field("depth_weight", depth_weight, {0.0, 10.0}, "", "of the height's vote");
    v.field("colour_weight", colour_weight, {0.0, 10.0}, "", "of the colour's vote");
    v.field("edge_level", edge_level, {1.0, 255.0}, "levels",
            "colour step between neighbours that halves how far votes carry");
    v.field("edge_height_sigma", edge_height_sigma, {0.05, 100.0}, "",
            "step in height between neighbours that does so, in units of the table's noise");
    v.field("reach_cells", reach_cells, {1.0, 10000.0}, "cells",
            "how far votes carry where everything looks alike");
    v.field("iterations", iterations, {1, 20}, "", "of colour model and votes, twice over");
    v.field("min_component_cm2", min_component_cm2, {0.0, 10000.0}, "cm2",
            "smallest piece of cloth, on the table");
    v.field("max_hole_cm2", max_hole_cm2, {0.0, 10000.0}, "cm2",
            "largest hole that is filled whatever is seen in it");
    v.field("min_component_height_mm", min_component_height_mm, {0.0, 100.0}, "mm",
            "mean height of a piece of cloth at least; shadows and stains have none");
    v.field("max_outline_passage", max_outline_passage, {0.0, 1.0}, "",
            "mean likeness of colour across the outline of a piece of cloth at most (cloth on real "
            "scans: 0.01 to 0.52, false pieces 0.84 to 0.95), or else it needs a step in height");
    v.field("min_outline_step_sigma", min_outline_step_sigma, {0.0, 100.0}, "",
            "mean step in height across the outline that makes up for a missing colour edge, in "
            "units of the table's noise (false pieces: up to 0.6)");
  }
  void validate() const { validate_fields(*this, "SegmentOptions"); }
};

struct ForegroundOptions {
  Foreground::Source mode = Foreground::Source::kLive;
  TableOptions table;
  SegmentOptions segment;

  void visit(OptionVisitor& v) {
    v.choice("mode", mode,
             {{"live", Foreground::Source::kLive}, {"dataset", Foreground::Source::kDataset}},
             "live: segment each frame; dataset: take the mask that came with the frame");
    v.group("table", table);
    v.group("segment", segment);
  }
  void validate() const { validate_fields(*this, "ForegroundOptions"); }
};

/// Table and mask. Without a table a live mask stays empty. In mode dataset the table is looked for
/// outside the frame's mask; throws Error when the frame brings no mask. About 30 ms for 640x480
/// px. Class A: the same bits everywhere.
Foreground find_foreground(const rgbd::RgbdFrame& frame, const ForegroundOptions& options);

}  // namespace weft::foreground
