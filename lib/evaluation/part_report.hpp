#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "evaluation/part_metrics.hpp"

/// Part scores as a table for people and as JSON for scripts.
namespace weft::evaluation {

/// One line a part with positives or sure detections, the means, and how many of the sure
/// detections are right.
std::string to_table(const Evaluation& evaluation);

/// {"threshold", "map", "mean_recall_at_1", "parts": {NAME: {"positives", "positive_images",
/// "images", "detections", "sure", "sure_right", "recall_at_1", ..., "ap", "ap11"}}}; null where
/// there is nothing to divide by.
nlohmann::json to_json(const Evaluation& evaluation);

}  // namespace weft::evaluation
