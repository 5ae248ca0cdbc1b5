#pragma once

#include <map>
#include <string>
#include <vector>

#include "evaluation/part_metrics.hpp"

/// Which of two runs is nearer to the truth.
namespace weft {

struct TruthComparison {
  /// An image whose best detection of a part is right in one run and wrong in the other.
  struct Change {
    std::string image, part;
    bool gained = false;  // right in B
  };
  std::size_t images = 0;                                             // judged in both
  evaluation::Evaluation a, b;                                        // over these
  std::vector<Change> changes;                                        // by image
  std::size_t failed_a = 0, failed_b = 0;                             // images without an answer
  std::map<std::string, std::vector<dataset::PartPolygon>> polygons;  // by image
};

/// Judges two logs of the same frames by a dataset whose scenes they show (judge_log). Images that
/// one of them lacks are left out. threshold: of sure detections. Throws Error when no image is in
/// both.
TruthComparison compare_with_truth(const std::string& log_a, const std::string& channel_a,
                                   const std::string& log_b, const std::string& channel_b,
                                   const std::string& dataset, double threshold);

}  // namespace weft
