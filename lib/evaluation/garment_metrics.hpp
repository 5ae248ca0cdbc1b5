#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "dataset/garment_truth.hpp"
#include "slam/garment_map.hpp"

/// How well the garments of a map agree with the truth.
namespace weft::evaluation {

struct GarmentOptions {
  double max_garment_distance_m = 0.2;
  double max_part_distance_m = 0.1;
  double min_seen_share = 0.2;
  double min_probability = 0.1;

  void visit(OptionVisitor& v) {
    v.field("max_garment_distance_m", max_garment_distance_m, {0.0, 100.0}, "m",
            "between a garment of the map and the true one it is taken for");
    v.field("max_part_distance_m", max_part_distance_m, {0.0, 100.0}, "m",
            "likewise between parts of the same name");
    v.field(
        "min_seen_share", min_seen_share, {0.0, 1.0}, "",
        "of a true part's surface, both faces; parts less visible are neither found nor missed");
    v.field("min_probability", min_probability, {0.0, 1.0}, "", "of a part that counts as found");
  }
  void validate() const { validate_fields(*this, "GarmentOptions"); }
};

struct PartResult {
  int garment = 0;  // index of the true one
  std::string part, instance;
  bool found = false;
  double error_m = 0.0;      // of its position, when found
  double chi_squared = 0.0;  // of that error, 3 degrees of freedom
  double probability = 0.0;
};

struct GarmentEvaluation {
  struct Found {
    int garment = 0;  // index of the true one
    slam::Id id = 0;  // in the map
    double error_m = 0.0;
  };
  int garments = 0;        // true ones
  int false_garments = 0;  // of the map, that are none
  int candidates = 0;      // not in the map yet: these do not count
  std::vector<Found> found;
  std::vector<PartResult> parts;  // that can be seen, of all true garments
  int false_parts = 0;            // of garments found, and all of false ones
};

/// found: positions and covariances in the truth's frame. Garments, then the parts of each pair,
/// are assigned with the least total distance.
GarmentEvaluation evaluate_garments(std::span<const dataset::TrueGarment> truth,
                                    std::span<const slam::Garment> found,
                                    const GarmentOptions& options);

/// The same garment where T moves it: positions, covariances, directions of grasps.
slam::Garment transformed(slam::Garment garment, const slam::Rigid3d& T);

/// A table for people.
std::string to_table(const GarmentEvaluation& evaluation,
                     std::span<const dataset::TrueGarment> truth);
nlohmann::json to_json(const GarmentEvaluation& evaluation,
                       std::span<const dataset::TrueGarment> truth);

}  // namespace weft::evaluation
