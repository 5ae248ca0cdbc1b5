#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "detector/types.hpp"
#include "weft/grasps_t.hpp"

/// GRASPS to and from its message.
namespace weft::messages {

/// Fills in everything but header and status; with T_base_camera also the fields in the robot's
/// base.
void to_message(const std::vector<detector::Grasp>& grasps,
                const std::optional<Eigen::Isometry3d>& T_base_camera, grasps_t& message);

/// Throws stage::InvalidInput for content no sender of ours makes: numbers that are not finite, an
/// approach not of unit length, a score outside 0 to 1, an index below 0.
std::vector<detector::Grasp> from_message(const grasps_t& message);

}  // namespace weft::messages
