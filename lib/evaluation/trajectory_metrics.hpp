#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/options.hpp"
#include "dataset/trajectory_file.hpp"

/// How well a camera path agrees with the truth.
/// ATE, RPE: Sturm et al., A Benchmark for the Evaluation of RGB-D SLAM Systems, IROS 2012.
/// Alignment: Umeyama, PAMI 1991, without scale. Segments: Geiger et al., KITTI, CVPR 2012.
namespace weft::evaluation {

struct TrajectoryOptions {
  enum class Alignment { kSe3, kFirst, kNone };
  double max_time_difference_s = 0.02;
  Alignment alignment = Alignment::kSe3;
  int rpe_step = 1;
  std::vector<double> segment_lengths_m = {0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0};

  void visit(OptionVisitor& v) {
    v.field("max_time_difference_s", max_time_difference_s, {0.0, 10.0}, "s",
            "between a pose and the truth it is compared with");
    v.choice(
        "alignment", alignment,
        {{"se3", Alignment::kSe3}, {"first", Alignment::kFirst}, {"none", Alignment::kNone}},
        "se3: the rigid motion that makes the positions fit best; first: the first pose is the "
        "truth's; none: both are in one frame already");
    v.field("rpe_step", rpe_step, {1, 1'000'000}, "",
            "compared poses between the two of a relative pose error: 1 for drift a frame");
    v.field(
        "segment_lengths_m", segment_lengths_m, {0, 32}, "m",
        "lengths of the true path over which relative errors are taken, as KITTI's 100 to 800 m");
  }
  /// Lengths must be positive.
  void validate() const;
};

/// Indices of an estimated pose and the truth it is compared with.
using Association = std::pair<std::size_t, std::size_t>;

/// Pairs at most max_difference_us apart, each pose once, the closest pairs first (of equal ones
/// the earlier); in order of time. Both trajectories are in order of time.
std::vector<Association> associate(const dataset::Trajectory& estimate,
                                   const dataset::Trajectory& truth,
                                   std::int64_t max_difference_us);

struct ErrorStatistics {
  std::int64_t count = 0;
  double rmse = 0.0, mean = 0.0, median = 0.0, max = 0.0;  // 0 when there is nothing
};

/// Relative errors over segments of one true length.
struct SegmentErrors {
  double length_m = 0.0;
  std::int64_t count = 0;
  double translation_percent = 0.0;  // mean of |error| / length
  double rotation_deg_per_m = 0.0;
};

struct TrajectoryEvaluation {
  std::size_t estimated = 0;                                           // poses of the estimate
  std::size_t truths = 0;                                              // poses of the truth
  std::size_t poses = 0;                                               // compared
  Eigen::Isometry3d T_truth_estimate = Eigen::Isometry3d::Identity();  // of the alignment
  ErrorStatistics ate_m;         // of positions, after alignment
  ErrorStatistics rotation_deg;  // of orientations, after alignment
  /// Between compared poses rpe_step apart; no alignment enters.
  ErrorStatistics rpe_translation_m, rpe_rotation_deg;
  /// Between every two compared poses (every k-th, so that at most 1000 take part).
  ErrorStatistics pair_translation_m, pair_rotation_deg;
  std::vector<SegmentErrors> segments;  // of the lengths the path reaches
  SegmentErrors all_segments;           // over all lengths, length_m 0
  std::vector<Association> pairs;
};

/// Throws Error when no pose has a truth, saying which times there are.
TrajectoryEvaluation evaluate_trajectory(const dataset::Trajectory& estimate,
                                         const dataset::Trajectory& truth,
                                         const TrajectoryOptions& options);

/// A table for people. frames: of the recording, for the share that has a pose.
std::string to_table(const TrajectoryEvaluation& evaluation, std::size_t frames);
/// {"ate_rmse_m", "rpe_trans_m", "rpe_rot_deg", "poses", "frames", ...}
nlohmann::json to_json(const TrajectoryEvaluation& evaluation, std::size_t frames);

}  // namespace weft::evaluation
