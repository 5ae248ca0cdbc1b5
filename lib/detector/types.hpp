#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "rgbd/view.hpp"

namespace weft::detector {

/// The eleven parts of papers/garment-parts.txt Table 1, in its order.
inline constexpr std::array<const char*, 11> kParts = {
    "shirt collar", "shirt sleeves",       "t-shirt collar", "t-shirt sleeves",
    "jeans hips",   "jeans pants hemline", "polo collar",    "polo sleeves",
    "sweater hood", "sweater sleeves",     "dress collar"};

/// off: every part is searched, scores untouched. soft: every part is searched, detection scores
/// are multiplied by the prior. hard: parts below their threshold are not searched.
enum class PriorMode { kOff, kSoft, kHard };

struct PartPrior {
  std::string part;
  double probability = 1.0;
  double threshold = 0.0;
  bool searched = true;
};

/// A local peak of a part's probability map.
struct Candidate {
  std::string part;
  int column = 0;  // grid point of the peak
  int row = 0;
  double probability = 0.0;
  double prior = 1.0;  // factor on the detection's score
};

/// Probability of a part at each grid point, 8 bit: value / 255 * full_scale.
struct ProbabilityMap {
  std::string part;
  double full_scale = 1.0;
  std::vector<std::uint8_t> values;  // row-major, the word grid's columns * rows
};

struct Box {
  double x = 0.0, y = 0.0, width = 0.0, height = 0.0;  // px: left, top, size
};

struct Detection {
  std::string part;
  double probability = 0.0;
  Box box_view;
  Eigen::Vector2d centre_sensor_px = Eigen::Vector2d::Zero();
  std::array<Eigen::Vector2d, 4> corners_sensor_px;  // clockwise from the view's top left
};

struct Grasp {
  std::string part;
  int detection = 0;  // index in the frame's detections
  double score = 0.0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();           // sensor px
  Eigen::Vector3d point_camera_m = Eigen::Vector3d::Zero();  // on the cloth
  Eigen::Vector3d approach_camera =
      Eigen::Vector3d::Zero();  // unit, from the gripper into the cloth
};

}  // namespace weft::detector
