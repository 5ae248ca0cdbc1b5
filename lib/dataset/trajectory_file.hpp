#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

/// Camera paths as text, in the format of the TUM RGB-D benchmark.
namespace weft::dataset {

/// Where the camera was at one time. T_world_camera takes points of the camera frame (x right, y
/// down, z forward) to the world's, metres.
struct StampedPose {
  std::int64_t utime = 0;  // microseconds
  Eigen::Quaterniond rotation_world_camera = Eigen::Quaterniond::Identity();
  Eigen::Vector3d camera_in_world = Eigen::Vector3d::Zero();

  Eigen::Isometry3d T_world_camera() const {
    return Eigen::Translation3d(camera_in_world) * rotation_world_camera;
  }
};

using Trajectory = std::vector<StampedPose>;

/// A decimal number of seconds as whole microseconds, without the rounding of floating point.
/// Throws Error naming `where` when it is none, or beyond +-2^62 microseconds.
std::int64_t parse_stamp_us(std::string_view text, const std::string& where);
/// Seconds with six decimals.
std::string format_stamp(std::int64_t utime);

/// Lines "stamp tx ty tz qx qy qz qw": seconds, metres, a quaternion of unit length within 1e-2
/// (normalised here: published files carry four digits). Blank lines and lines that begin with #
/// are skipped; the poses come out by time. Throws Error naming `where`, the line and what is
/// wrong, and when there is no pose or a time occurs twice.
Trajectory parse_trajectory(std::string_view text, const std::string& where);
Trajectory read_trajectory(const std::string& path);

/// The same format: stamps to a microsecond, numbers with 9 decimals (a nanometre).
std::string format_trajectory(const Trajectory& trajectory);
/// Throws Error when the file cannot be written.
void write_trajectory(const std::string& path, const Trajectory& trajectory);

}  // namespace weft::dataset
