#include "synth/recipe.hpp"

#include <cmath>
#include <set>

#include "base/error.hpp"

namespace weft::synth {

void SimulationOptions::validate() const {
  validate_fields(*this, "SimulationOptions");
  static const std::set<std::string> kKnown = {"tshirt",  "polo",  "jeans", "shirt",
                                               "sweater", "dress", "towel", "blanket"};
  if (garments.empty()) throw Error("simulation.garments: empty; name at least one type");
  for (const auto& garment : garments) {
    if (kKnown.contains(garment)) continue;
    std::string known;
    for (const auto& each : kKnown) known += " " + each;
    throw Error("simulation.garments: there is no '" + garment + "'; known are" + known);
  }
  double sum = 0.0;
  for (const double share : state_shares) {
    if (share < 0.0) throw Error("simulation.state_shares: a share is negative");
    sum += share;
  }
  if (std::abs(sum - 1.0) > 1e-9)
    throw Error("simulation.state_shares: the four shares must add up to 1");
}

}  // namespace weft::synth
