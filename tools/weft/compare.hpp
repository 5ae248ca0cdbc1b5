#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/weft/compare_truth.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/message_types.hpp"
#include "tools/weft/timing_report.hpp"

/// What differs between two runs over the same frames.
namespace weft {

struct CompareOptions {
  double threshold = 0.2;  // detections less probable do not count
  double overlap = 0.5;    // intersection over union from which two detections are the same
  /// Not empty: log_b is not read; CHANNEL@variant of log_a is compared with its CHANNEL, and stage
  /// NAME@variant with NAME.
  std::string variant;
  std::string truth;                        // dataset folder of the frames' scenes; empty: none
  std::string channel = "PART_DETECTIONS";  // what is judged by it; the variant's has the suffix
};

struct ChannelComparison {
  std::string type;
  std::size_t equal = 0, different = 0;  // messages both have
  std::size_t only_a = 0, only_b = 0;
  std::size_t other_status = 0;               // of the different ones
  std::map<std::string, std::size_t> fields;  // that differ, without indices: in how many messages
};

struct Detection {
  std::string part;
  double probability = 0;
  std::array<std::array<double, 2>, 4> corners{};  // sensor px
};

/// One frame that differs in any payload.
struct FrameComparison {
  FrameName frame;
  std::vector<std::string> channels;          // that differ
  std::vector<Detection> kept, gained, lost;  // kept: as in B
  std::string source_a;                       // file the picture is in
  std::size_t change() const { return gained.size() + lost.size(); }
};

struct Comparison {
  std::string name_a, name_b;
  std::map<std::string, ChannelComparison> channels;
  std::size_t frames = 0;                      // about which there is any compared message
  std::vector<FrameComparison> different;      // in the order of A
  std::size_t kept = 0, gained = 0, lost = 0;  // detections
  std::map<std::string, std::array<std::size_t, 3>> parts;  // kept, gained, lost
  double probability_shift = 0;                             // largest change of a kept detection's
  double corner_shift_px = 0;                               // largest of a kept detection's corner
  std::size_t grasps = 0;                                   // compared, of one part and detection
  Quantiles grasp_shift_mm;
  std::size_t poses = 0;  // of frames tracked in both
  std::size_t poses_gained = 0, poses_lost = 0;
  Quantiles camera_shift_mm, camera_turn_deg;
  TimingReport timing_a, timing_b;
  std::optional<TruthComparison> truth;
  std::vector<std::string> damage;
  bool same() const;  // in every payload
};

Comparison compare_logs(const std::string& log_a, const std::string& log_b,
                        const CompareOptions& options, const MessageTypes& types);

/// Intersection over union of the boxes around two detections' corners.
double overlap(const Detection& a, const Detection& b);

std::string to_text(const Comparison& comparison);
std::string to_json(const Comparison& comparison);
/// One file with everything in it. pictures: frames shown, the most different first.
std::string to_page(const Comparison& comparison, std::size_t pictures);

}  // namespace weft
