#pragma once

#include <memory>
#include <string>
#include <vector>

#include "detector/model.hpp"
#include "detector/part_scorer.hpp"
#include "detector/prior.hpp"
#include "detector/refiner.hpp"

/// The whole detector on a frame: view, words, prior, scores, refinement. The processes
/// weft-describe to weft-refine compute the same, one step each.
namespace weft::detector {

struct DetectorOptions {
  PriorMode prior = PriorMode::kOff;
  ScoreOptions score;
  RefinerOptions refine;

  void visit(OptionVisitor& v) {
    v.choice(
        "prior", prior,
        {{"off", PriorMode::kOff}, {"soft", PriorMode::kSoft}, {"hard", PriorMode::kHard}},
        "image-level prior: off, soft (weighs scores) or hard (parts below their threshold are "
        "not searched)");
    v.group("score", score);
    v.group("refine", refine);
  }
  void validate() const {
    validate_fields(*this, "DetectorOptions");
    score.validate();
    refine.validate();
  }
};

struct DetectorResult {
  std::vector<bovw::WordGrid> grids;  // one a descriptor
  std::vector<PartPrior> priors;
  PartScores scores;
  std::vector<Detection> detections;  // best first
};

class Detector {
 public:
  Detector(ModelBundle bundle, const DetectorOptions& options);

  /// mask: CV_8UC1 of the frame's size; table: null when there is none. Throws Error where the
  /// steps do.
  DetectorResult detect(const rgbd::RgbdFrame& frame, const cv::Mat& mask, const rgbd::Plane* table,
                        int threads) const;
  /// From the words on.
  DetectorResult detect_words(std::vector<bovw::WordGrid> grids, int threads) const;

  const ModelBundle& bundle() const { return bundle_; }

 private:
  ModelBundle bundle_;
  DetectorOptions options_;
  Refiner refiner_;
  std::vector<std::unique_ptr<descriptor::DenseDescriptor>> descriptors_;
};

}  // namespace weft::detector
