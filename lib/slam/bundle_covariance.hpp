#pragma once

#include "slam/bundle_adjustment.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {

/// Fills the covariances of the summary that the options ask for: blocks of the inverse of the
/// inliers' information, without Huber's kernel, at the problem's numbers. Points are eliminated
/// first; the rest is inverted densely.
void add_covariances(const BundleProblem& problem, const CameraModel& camera,
                     const std::vector<PlaneFactor>& factors, const BundleOptions& options,
                     BundleSummary& summary);

}  // namespace weft::slam
