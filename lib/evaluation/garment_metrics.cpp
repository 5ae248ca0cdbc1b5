#include "evaluation/garment_metrics.hpp"

#include <Eigen/Cholesky>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "slam/assignment.hpp"

namespace weft::evaluation {
namespace {

/// Rows to columns by distance; pairs farther apart than most_m, or not allowed, are none.
template <class Allowed>
std::vector<int> assign_nearest(const std::vector<Eigen::Vector3d>& rows,
                                const std::vector<Eigen::Vector3d>& columns, double most_m,
                                Allowed allowed) {
  Eigen::MatrixXd costs = Eigen::MatrixXd::Constant(static_cast<Eigen::Index>(rows.size()),
                                                    static_cast<Eigen::Index>(columns.size()),
                                                    std::numeric_limits<double>::infinity());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const double distance_m = (rows[r] - columns[c]).norm();
      if (distance_m <= most_m && allowed(r, c))
        costs(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) = distance_m;
    }
  }
  return slam::assign(costs, most_m);
}

void evaluate_parts(int index, const dataset::TrueGarment& truth, const slam::Garment* found,
                    const GarmentOptions& options, GarmentEvaluation& out) {
  std::vector<Eigen::Vector3d> rows, columns;
  std::vector<const slam::GarmentPart*> seen;
  for (const auto& part : truth.parts) rows.push_back(part.position_world);
  if (found != nullptr) {
    for (const auto& part : found->parts) {
      if (part.probability < options.min_probability) continue;
      seen.push_back(&part);
      columns.push_back(part.position_world);
    }
  }
  const auto column_of = assign_nearest(
      rows, columns, options.max_part_distance_m,
      [&](std::size_t r, std::size_t c) { return truth.parts[r].part == seen[c]->part; });
  std::size_t taken = 0;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const auto& part = truth.parts[r];
    taken += column_of[r] >= 0 ? 1 : 0;
    if (part.seen_share < options.min_seen_share) continue;
    PartResult result;
    result.garment = index;
    result.part = part.part;
    result.instance = part.instance;
    result.found = column_of[r] >= 0;
    if (result.found) {
      const auto& match = *seen[static_cast<std::size_t>(column_of[r])];
      const Eigen::Vector3d error = match.position_world - part.position_world;
      result.error_m = error.norm();
      result.chi_squared = error.dot(match.covariance.ldlt().solve(error));
      result.probability = match.probability;
    }
    out.parts.push_back(std::move(result));
  }
  out.false_parts += static_cast<int>(seen.size() - taken);
}

}  // namespace

GarmentEvaluation evaluate_garments(std::span<const dataset::TrueGarment> truth,
                                    std::span<const slam::Garment> found,
                                    const GarmentOptions& options) {
  options.validate();
  GarmentEvaluation out;
  out.garments = static_cast<int>(truth.size());
  std::vector<Eigen::Vector3d> rows, columns;
  std::vector<const slam::Garment*> in_map;
  std::set<slam::Id> matched;
  for (const auto& each : truth) rows.push_back(each.position_world);
  for (const auto& each : found) {
    if (!each.in_map) {
      ++out.candidates;
      continue;
    }
    in_map.push_back(&each);
    columns.push_back(each.position_world);
  }
  const auto column_of = assign_nearest(rows, columns, options.max_garment_distance_m,
                                        [](std::size_t, std::size_t) { return true; });
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const int index = static_cast<int>(r);
    const slam::Garment* match =
        column_of[r] < 0 ? nullptr : in_map[static_cast<std::size_t>(column_of[r])];
    if (match != nullptr)
      out.found.push_back({index, match->id, (match->position_world - rows[r]).norm()});
    if (match != nullptr) matched.insert(match->id);
    evaluate_parts(index, truth[r], match, options, out);
  }
  out.false_garments = static_cast<int>(in_map.size() - out.found.size());
  for (const auto* garment : in_map) {
    if (matched.contains(garment->id)) continue;
    for (const auto& part : garment->parts)
      out.false_parts += part.probability >= options.min_probability ? 1 : 0;
  }
  return out;
}

slam::Garment transformed(slam::Garment garment, const slam::Rigid3d& T) {
  const Eigen::Matrix3d R = T.rotation.toRotationMatrix();
  garment.position_world = T * garment.position_world;
  garment.covariance = R * garment.covariance * R.transpose();
  for (auto& part : garment.parts) {
    part.position_world = T * part.position_world;
    part.covariance = R * part.covariance * R.transpose();
    part.approach_world = R * part.approach_world;
  }
  return garment;
}

std::string to_table(const GarmentEvaluation& evaluation,
                     std::span<const dataset::TrueGarment> truth) {
  std::string out;
  char line[256];
  const auto add = [&](auto... values) {
    std::snprintf(line, sizeof line, values...);
    out += line;
  };
  add("%zu of %d garments found, %d false, %d candidates\n", evaluation.found.size(),
      evaluation.garments, evaluation.false_garments, evaluation.candidates);
  for (const auto& each : evaluation.found) {
    const auto& name = truth[static_cast<std::size_t>(each.garment)].garment;
    add("  %-26.60s %6.1f cm off\n", name.c_str(), 100.0 * each.error_m);
  }
  std::size_t found = 0;
  for (const auto& part : evaluation.parts) found += part.found ? 1 : 0;
  add("%zu of %zu visible parts found, %d false\n", found, evaluation.parts.size(),
      evaluation.false_parts);
  for (const auto& part : evaluation.parts) {
    const std::string name = part.part + (part.instance.empty() ? "" : ", " + part.instance);
    if (part.found) {
      add("  %-26.60s %6.1f cm off, chi-squared %5.1f of 3, probability %.2f\n", name.c_str(),
          100.0 * part.error_m, part.chi_squared, part.probability);
    } else {
      add("  %-26.60s missed\n", name.c_str());
    }
  }
  return out;
}

nlohmann::json to_json(const GarmentEvaluation& evaluation,
                       std::span<const dataset::TrueGarment> truth) {
  nlohmann::json found = nlohmann::json::array(), parts = nlohmann::json::array();
  for (const auto& each : evaluation.found) {
    found.push_back({{"garment", truth[static_cast<std::size_t>(each.garment)].garment},
                     {"index", each.garment},
                     {"id", each.id},
                     {"error_m", each.error_m}});
  }
  for (const auto& part : evaluation.parts) {
    nlohmann::json entry = {{"garment", part.garment},
                            {"part", part.part},
                            {"instance", part.instance},
                            {"found", part.found}};
    if (part.found) {
      entry["error_m"] = part.error_m;
      entry["chi_squared"] = part.chi_squared;
      entry["probability"] = part.probability;
    }
    parts.push_back(std::move(entry));
  }
  return {{"garments", evaluation.garments},
          {"found", found},
          {"false_garments", evaluation.false_garments},
          {"candidates", evaluation.candidates},
          {"parts", parts},
          {"false_parts", evaluation.false_parts}};
}

}  // namespace weft::evaluation
