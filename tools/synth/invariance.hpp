#pragma once

#include <functional>
#include <string>
#include <vector>

#include "bovw/describe.hpp"

/// How well descriptors of the same place on cloth match when the camera changes.
namespace weft::synth {

/// One change of the camera, all else the same: the base camera looks straight down from 0.8 m.
enum class Change { kNoise, kTurn, kTilt, kDistance };
inline constexpr Change kChanges[] = {Change::kNoise, Change::kTurn, Change::kTilt,
                                      Change::kDistance};
const char* change_name(Change change);            // "noise", ...
const char* change_unit(Change change);            // of levels: "x", "deg", "m"
std::vector<double> change_levels(Change change);  // those of the plot, ascending

struct CameraChange {
  Change change = Change::kNoise;
  double level = 0.0;
};
std::vector<CameraChange> plotted_changes();

/// One descriptor, in one view, under one change.
struct MatchStability : CameraChange {
  /// Share of pairs (true match, other place of the garment) in which the true match is the nearer:
  /// 0.5 is chance, 1 perfect. Mean over the garments.
  double stability = 0.0;
  /// Share of the described points seen in both pictures that are described in both.
  double described = 0.0;
  int points = 0;  // pairs of the same place, in all garments
};

/// simulations: .wsim files, each rendered in a fabric of its own. The true match of a grid point
/// is the grid point nearest to where its place on the cloth, known from the renderer, is seen
/// after the change. Hidden places do not count. Result: by describe options, then by changes.
std::vector<std::vector<MatchStability>> measure_invariance(
    const std::vector<std::string>& simulations, const std::vector<bovw::DescribeOptions>& describe,
    const std::vector<CameraChange>& changes, int threads,
    const std::function<void(int done, int total)>& report);

/// A row of diagrams for each view (sensor, rectified), a column for each change, a line for each
/// descriptor; SVG. names: of the descriptors, by results, sensor view first, then rectified.
std::string invariance_plot(const std::vector<std::string>& names,
                            const std::vector<std::vector<MatchStability>>& sensor,
                            const std::vector<std::vector<MatchStability>>& rectified);

}  // namespace weft::synth
