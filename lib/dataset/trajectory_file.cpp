#include "dataset/trajectory_file.hpp"

#include <algorithm>
#include <cstdio>

#include "dataset/text_lines.hpp"

namespace weft::dataset {

std::int64_t parse_stamp_us(std::string_view text, const std::string& where) {
  const auto fail = [&]() -> std::int64_t {
    throw Error(where + ": '" + std::string(text.substr(0, 40)) + "' is no time in seconds");
  };
  // 9007199254740993.123457 must not lose digits; exponents go the rounding way.
  if (text.find_first_of("eE") != std::string_view::npos) {
    const double us = parse_number(text, where) * 1e6;
    return std::abs(us) < 0x1p62 ? static_cast<std::int64_t>(std::llround(us)) : fail();
  }
  std::size_t at = 0;
  const bool negative = !text.empty() && text[0] == '-';
  if (!text.empty() && (text[0] == '-' || text[0] == '+')) ++at;
  std::int64_t us = 0;
  int digits = 0, decimals = -1;
  bool round_up = false;
  for (; at < text.size(); ++at) {
    const char c = text[at];
    if (c == '.' && decimals < 0) {
      decimals = 0;
    } else if (c >= '0' && c <= '9') {
      ++digits;
      if (decimals >= 6) {
        if (decimals++ == 6) round_up = c >= '5';
        continue;
      }
      if (decimals >= 0) ++decimals;
      if (us > (std::int64_t{1} << 62) / 10 - 10) return fail();
      us = 10 * us + (c - '0');
    } else {
      return fail();
    }
  }
  if (digits == 0) return fail();
  for (int d = std::max(decimals, 0); d < 6; ++d) {
    if (us > (std::int64_t{1} << 62) / 10) return fail();
    us *= 10;
  }
  us += round_up;
  return negative ? -us : us;
}

std::string format_stamp(std::int64_t utime) {
  const bool negative = utime < 0;
  const std::uint64_t us =
      negative ? 0 - static_cast<std::uint64_t>(utime) : static_cast<std::uint64_t>(utime);
  char text[40];
  std::snprintf(text, sizeof text, "%s%llu.%06llu", negative ? "-" : "",
                static_cast<unsigned long long>(us / 1'000'000),
                static_cast<unsigned long long>(us % 1'000'000));
  return text;
}

Trajectory parse_trajectory(std::string_view text, const std::string& where) {
  Trajectory trajectory;
  for (const TextLine& line : split_lines(text, where)) {
    if (line.words.size() != 8) {
      throw Error(line.where + ": " + std::to_string(line.words.size()) +
                  " words; a pose is 'stamp tx ty tz qx qy qz qw'");
    }
    StampedPose pose;
    pose.utime = parse_stamp_us(line.words[0], line.where);
    double v[7];
    for (std::size_t i = 0; i < 7; ++i) v[i] = parse_number(line.words[i + 1], line.where);
    pose.camera_in_world = {v[0], v[1], v[2]};
    pose.rotation_world_camera = Eigen::Quaterniond(v[6], v[3], v[4], v[5]);
    const double norm = pose.rotation_world_camera.norm();
    if (!(std::abs(norm - 1.0) <= 1e-2)) {
      throw Error(line.where + ": the quaternion has length " + std::to_string(norm) +
                  ", not 1; its order is qx qy qz qw");
    }
    pose.rotation_world_camera.normalize();
    trajectory.push_back(pose);
  }
  if (trajectory.empty())
    throw Error(where + ": holds no pose ('stamp tx ty tz qx qy qz qw' a line)");
  std::stable_sort(trajectory.begin(), trajectory.end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.utime < b.utime; });
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    if (trajectory[i].utime == trajectory[i - 1].utime)
      throw Error(where + ": two poses at " + format_stamp(trajectory[i].utime) + " s");
  }
  return trajectory;
}

Trajectory read_trajectory(const std::string& path) {
  return parse_trajectory(read_text(path), path);
}

std::string format_trajectory(const Trajectory& trajectory) {
  std::string text = "# timestamp tx ty tz qx qy qz qw\n";
  for (const StampedPose& pose : trajectory) {
    text += format_stamp(pose.utime);
    const Eigen::Vector3d& t = pose.camera_in_world;
    const Eigen::Quaterniond& q = pose.rotation_world_camera;
    for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()}) {
      char number[400];
      std::snprintf(number, sizeof number, " %.9f", value);
      text += number;
    }
    text += '\n';
  }
  return text;
}

void write_trajectory(const std::string& path, const Trajectory& trajectory) {
  std::ofstream out(path, std::ios::binary);
  out << format_trajectory(trajectory);
  out.close();
  if (!out) throw Error(path + ": cannot be written");
}

}  // namespace weft::dataset
