#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "dataset/scene.hpp"
#include "detector/pipeline.hpp"
#include "evaluation/part_metrics.hpp"

/// Where judged images come from: the detector run on a dataset, or a log.
namespace weft::evaluate {

struct Selection {
  std::string split;                // only scenes of this split; empty: all
  std::vector<std::string> scenes;  // only these, in all their rotations; empty: all
  bool easy = false;                // only the Easy subset
  bool several = false;             // also scenes with several garments

  /// name: of the scene, with or without the suffix of an augmentation.
  bool wants_name(const std::string& name) const;
  bool wants(const dataset::Scene& scene) const;
};

using Report = std::function<void(int done, int total)>;
using Note = std::function<void(const std::string& text)>;
/// Sees each image with its colour picture and detections of mode off.
using Observer = std::function<void(const evaluation::JudgedImage& image, const cv::Mat& colour)>;

/// Judged images by prior mode: "off", "soft", "hard".
using JudgedByMode = std::map<std::string, std::vector<evaluation::JudgedImage>>;

/// Runs the detector on every selected scene. live: segment, even where the dataset has masks.
/// Scenes that cannot be read or processed are noted; a scene that was read but could not be
/// processed is judged as one without detections. failed counts them.
JudgedByMode judge_dataset(const dataset::Dataset& data, const detector::Detector& detector,
                           const Selection& selection, bool live, int threads, int& failed,
                           const Report& report, const Note& note, const Observer& observer);

/// Takes detections from `channel` of a log and the truth from the dataset by the frames' source
/// names ("00023@r45m"). Frames without an answer, and those answered FAILED, DROPPED or
/// MISSING_INPUT, are judged as images without detections and counted in `failed`.
std::vector<evaluation::JudgedImage> judge_log(const std::string& log, const std::string& channel,
                                               const dataset::Dataset& data,
                                               const Selection& selection, int& failed,
                                               const Report& report, const Note& note,
                                               const Observer& observer);

}  // namespace weft::evaluate
