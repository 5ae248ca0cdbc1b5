#pragma once

#include <Eigen/Core>
#include <vector>

namespace weft::slam {

/// The assignment of rows to columns with the least total cost, each used at most once: for each
/// row its column, or -1. Leaving a row without a column costs unassigned_cost, so a pair is made
/// only where it lowers the total; an infinite cost forbids a pair. Not nearest-first: the global
/// minimum (Hungarian method with shortest augmenting paths, O(n^3); Kuhn 1955, Jonker and
/// Volgenant 1987). Of equal minima the same one each time. Throws Error on NaN or minus infinity.
std::vector<int> assign(const Eigen::MatrixXd& costs, double unassigned_cost);

}  // namespace weft::slam
