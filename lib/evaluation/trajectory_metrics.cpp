#include "evaluation/trajectory_metrics.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <tuple>

#include "base/error.hpp"

namespace weft::evaluation {
namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Relative errors between all pairs of poses grow with the square of these.
constexpr std::size_t kMaxPairPoses = 1000;

double angle_deg(const Matrix3d& rotation) {
  const Eigen::Quaterniond q(rotation);
  return 2.0 * std::atan2(q.vec().norm(), std::abs(q.w())) * 180.0 / std::numbers::pi;
}

ErrorStatistics statistics(std::vector<double> errors) {
  ErrorStatistics result;
  result.count = static_cast<std::int64_t>(errors.size());
  if (errors.empty()) return result;
  double sum = 0.0, squares = 0.0;
  for (const double e : errors) {
    sum += e;
    squares += e * e;
  }
  const auto n = static_cast<double>(errors.size());
  result.mean = sum / n;
  result.rmse = std::sqrt(squares / n);
  std::sort(errors.begin(), errors.end());
  const std::size_t half = errors.size() / 2;
  result.median = errors.size() % 2 ? errors[half] : 0.5 * (errors[half - 1] + errors[half]);
  result.max = errors.back();
  return result;
}

/// The rigid motion of least squares from `from` to `to` (Umeyama 1991 without scale). Points on a
/// line or fewer than three leave a rotation open; any of them gives the same residuals.
Isometry3d align(const std::vector<Vector3d>& from, const std::vector<Vector3d>& to) {
  Vector3d from_mean = Vector3d::Zero(), to_mean = Vector3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_mean += from[i];
    to_mean += to[i];
  }
  from_mean /= static_cast<double>(from.size());
  to_mean /= static_cast<double>(from.size());
  Matrix3d scatter = Matrix3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i)
    scatter += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  const Eigen::JacobiSVD<Matrix3d> svd(scatter, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vector3d signs = Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0) signs.z() = -1.0;
  Isometry3d result = Isometry3d::Identity();
  result.linear() = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  result.translation() = to_mean - result.linear() * from_mean;
  return result;
}

struct Compared {
  std::vector<Isometry3d> estimate, truth;

  /// (truth's motion from i to j)^-1 * the estimate's
  Isometry3d relative_error(std::size_t i, std::size_t j) const {
    return (truth[i].inverse() * truth[j]).inverse() * (estimate[i].inverse() * estimate[j]);
  }
};

void add_segments(const Compared& compared, const std::vector<double>& lengths_m,
                  TrajectoryEvaluation& result) {
  std::vector<double> walked_m{0.0};
  for (std::size_t i = 1; i < compared.truth.size(); ++i) {
    walked_m.push_back(
        walked_m.back() +
        (compared.truth[i].translation() - compared.truth[i - 1].translation()).norm());
  }
  double percent = 0.0, deg_per_m = 0.0;
  for (const double length_m : lengths_m) {
    SegmentErrors errors;
    errors.length_m = length_m;
    for (std::size_t i = 0; i < walked_m.size(); ++i) {
      const auto end = std::lower_bound(walked_m.begin() + static_cast<std::ptrdiff_t>(i),
                                        walked_m.end(), walked_m[i] + length_m);
      if (end == walked_m.end()) break;
      const auto j = static_cast<std::size_t>(end - walked_m.begin());
      const Isometry3d error = compared.relative_error(i, j);
      errors.translation_percent += 100.0 * error.translation().norm() / length_m;
      errors.rotation_deg_per_m += angle_deg(error.linear()) / length_m;
      ++errors.count;
    }
    if (errors.count == 0) continue;
    percent += errors.translation_percent;
    deg_per_m += errors.rotation_deg_per_m;
    result.all_segments.count += errors.count;
    errors.translation_percent /= static_cast<double>(errors.count);
    errors.rotation_deg_per_m /= static_cast<double>(errors.count);
    result.segments.push_back(errors);
  }
  if (result.all_segments.count == 0) return;
  result.all_segments.translation_percent =
      percent / static_cast<double>(result.all_segments.count);
  result.all_segments.rotation_deg_per_m =
      deg_per_m / static_cast<double>(result.all_segments.count);
}

std::string span_of(const dataset::Trajectory& trajectory) {
  if (trajectory.empty()) return "no poses";
  return std::to_string(trajectory.size()) + " poses from " +
         dataset::format_stamp(trajectory.front().utime) + " to " +
         dataset::format_stamp(trajectory.back().utime) + " s";
}

}  // namespace

void TrajectoryOptions::validate() const {
  validate_fields(*this, "TrajectoryOptions");
  for (const double length_m : segment_lengths_m) {
    if (!(length_m > 0.0))
      throw Error("TrajectoryOptions: segment_lengths_m holds " + std::to_string(length_m) +
                  "; lengths are above 0");
  }
}

std::vector<Association> associate(const dataset::Trajectory& estimate,
                                   const dataset::Trajectory& truth,
                                   std::int64_t max_difference_us) {
  std::vector<std::tuple<std::int64_t, std::size_t, std::size_t>> candidates;
  std::size_t begin = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const std::int64_t utime = estimate[i].utime;
    while (begin < truth.size() && truth[begin].utime < utime - max_difference_us) ++begin;
    for (std::size_t j = begin; j < truth.size() && truth[j].utime <= utime + max_difference_us;
         ++j)
      candidates.emplace_back(std::abs(truth[j].utime - utime), i, j);
  }
  std::sort(candidates.begin(), candidates.end());
  std::vector<bool> estimate_taken(estimate.size()), truth_taken(truth.size());
  std::vector<Association> pairs;
  for (const auto& [difference, i, j] : candidates) {
    if (estimate_taken[i] || truth_taken[j]) continue;
    estimate_taken[i] = truth_taken[j] = true;
    pairs.emplace_back(i, j);
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

TrajectoryEvaluation evaluate_trajectory(const dataset::Trajectory& estimate,
                                         const dataset::Trajectory& truth,
                                         const TrajectoryOptions& options) {
  options.validate();
  TrajectoryEvaluation result;
  result.estimated = estimate.size();
  result.truths = truth.size();
  result.pairs =
      associate(estimate, truth,
                static_cast<std::int64_t>(std::llround(options.max_time_difference_s * 1e6)));
  result.poses = result.pairs.size();
  if (result.pairs.empty()) {
    throw Error("no pose has a truth within " + std::to_string(options.max_time_difference_s) +
                " s: the estimate has " + span_of(estimate) + ", the truth " + span_of(truth));
  }
  Compared compared;
  std::vector<Vector3d> from, to;
  for (const auto& [i, j] : result.pairs) {
    compared.estimate.push_back(estimate[i].T_world_camera());
    compared.truth.push_back(truth[j].T_world_camera());
    from.push_back(estimate[i].camera_in_world);
    to.push_back(truth[j].camera_in_world);
  }
  using Alignment = TrajectoryOptions::Alignment;
  if (options.alignment == Alignment::kSe3) result.T_truth_estimate = align(from, to);
  if (options.alignment == Alignment::kFirst)
    result.T_truth_estimate = compared.truth.front() * compared.estimate.front().inverse();

  std::vector<double> translations, rotations;
  for (std::size_t i = 0; i < result.poses; ++i) {
    const Isometry3d aligned = result.T_truth_estimate * compared.estimate[i];
    translations.push_back((aligned.translation() - to[i]).norm());
    rotations.push_back(angle_deg(compared.truth[i].linear().transpose() * aligned.linear()));
  }
  result.ate_m = statistics(translations);
  result.rotation_deg = statistics(rotations);

  const auto collect = [&](const auto& visit, ErrorStatistics& translation_m,
                           ErrorStatistics& rotation_deg) {
    translations.clear();
    rotations.clear();
    visit([&](std::size_t i, std::size_t j) {
      const Isometry3d error = compared.relative_error(i, j);
      translations.push_back(error.translation().norm());
      rotations.push_back(angle_deg(error.linear()));
    });
    translation_m = statistics(translations);
    rotation_deg = statistics(rotations);
  };
  const auto step = static_cast<std::size_t>(options.rpe_step);
  collect(
      [&](const auto& add) {
        for (std::size_t i = 0; i + step < result.poses; ++i) add(i, i + step);
      },
      result.rpe_translation_m, result.rpe_rotation_deg);
  const std::size_t stride = (result.poses + kMaxPairPoses - 1) / kMaxPairPoses;
  collect(
      [&](const auto& add) {
        for (std::size_t i = 0; i < result.poses; i += stride)
          for (std::size_t j = i + stride; j < result.poses; j += stride) add(i, j);
      },
      result.pair_translation_m, result.pair_rotation_deg);
  add_segments(compared, options.segment_lengths_m, result);
  return result;
}

std::string to_table(const TrajectoryEvaluation& evaluation, std::size_t frames) {
  std::string text = std::to_string(evaluation.estimated) + " poses of " + std::to_string(frames) +
                     " frames; " + std::to_string(evaluation.poses) + " of them have a truth\n";
  char line[160];
  const auto row = [&](const char* name, const ErrorStatistics& s, double factor,
                       const char* unit) {
    std::snprintf(line, sizeof line, "%-34s %9.3f %9.3f %9.3f %9.3f  %s\n", name, factor * s.rmse,
                  factor * s.mean, factor * s.median, factor * s.max, unit);
    text += line;
  };
  std::snprintf(line, sizeof line, "%-34s %9s %9s %9s %9s\n", "", "rmse", "mean", "median", "max");
  text += line;
  row("absolute trajectory error", evaluation.ate_m, 100.0, "cm");
  row("absolute rotation error", evaluation.rotation_deg, 1.0, "deg");
  row("relative pose error, translation", evaluation.rpe_translation_m, 100.0, "cm");
  row("relative pose error, rotation", evaluation.rpe_rotation_deg, 1.0, "deg");
  row("between all pairs, translation", evaluation.pair_translation_m, 100.0, "cm");
  row("between all pairs, rotation", evaluation.pair_rotation_deg, 1.0, "deg");
  const auto segment = [&](const std::string& name, const SegmentErrors& s) {
    std::snprintf(line, sizeof line, "%-34s %9.3f %% %9.3f deg/m  (%lld)\n", name.c_str(),
                  s.translation_percent, s.rotation_deg_per_m, static_cast<long long>(s.count));
    text += line;
  };
  for (const SegmentErrors& s : evaluation.segments) {
    char name[64];
    std::snprintf(name, sizeof name, "over %g m of the true path", s.length_m);
    segment(name, s);
  }
  if (evaluation.all_segments.count > 0) segment("over all these lengths", evaluation.all_segments);
  return text;
}

nlohmann::json to_json(const TrajectoryEvaluation& evaluation, std::size_t frames) {
  const auto of = [](const ErrorStatistics& s) {
    return nlohmann::json{{"count", s.count},
                          {"rmse", s.rmse},
                          {"mean", s.mean},
                          {"median", s.median},
                          {"max", s.max}};
  };
  const auto of_segments = [](const SegmentErrors& s) {
    return nlohmann::json{{"count", s.count},
                          {"translation_percent", s.translation_percent},
                          {"rotation_deg_per_m", s.rotation_deg_per_m}};
  };
  nlohmann::json json{{"ate_rmse_m", evaluation.ate_m.rmse},
                      {"rpe_trans_m", evaluation.rpe_translation_m.rmse},
                      {"rpe_rot_deg", evaluation.rpe_rotation_deg.rmse},
                      {"poses", evaluation.estimated},
                      {"frames", frames},
                      {"poses_with_truth", evaluation.poses},
                      {"truths", evaluation.truths},
                      {"ate_m", of(evaluation.ate_m)},
                      {"rotation_deg", of(evaluation.rotation_deg)},
                      {"rpe_translation_m", of(evaluation.rpe_translation_m)},
                      {"rpe_rotation_deg", of(evaluation.rpe_rotation_deg)},
                      {"pair_translation_m", of(evaluation.pair_translation_m)},
                      {"pair_rotation_deg", of(evaluation.pair_rotation_deg)},
                      {"segments", {{"all", of_segments(evaluation.all_segments)}}}};
  json["segments"]["lengths"] = nlohmann::json::array();
  for (const SegmentErrors& s : evaluation.segments) {
    auto entry = of_segments(s);
    entry["length_m"] = s.length_m;
    json["segments"]["lengths"].push_back(entry);
  }
  return json;
}

}  // namespace weft::evaluation
