#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

/// Where the garments of a recording and their parts are: garments.json beside groundtruth.txt, in
/// the frame of its poses.
namespace weft::dataset {

struct TruePart {
  std::string part;                                          // "polo sleeves"
  std::string instance;                                      // "left"; may be empty
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();  // middle of what is seen of it, m
  double seen_share = 0.0;                                   // of its surface, both faces
};

struct TrueGarment {
  std::string garment;                                       // "polo"
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();  // middle of its cloth, m
  std::vector<TruePart> parts;
};

/// {"garments": [{"garment", "position_m": [x, y, z], "parts": [{"part", "instance", "position_m",
/// "seen_share"}]}]}; other keys are skipped. Throws Error naming `where`, the garment and what is
/// wrong with it.
std::vector<TrueGarment> parse_garment_truth(std::string_view text, const std::string& where);
std::vector<TrueGarment> read_garment_truth(const std::string& path);

}  // namespace weft::dataset
