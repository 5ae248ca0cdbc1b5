#include "dataset/sequence.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <optional>

#include "base/error.hpp"
#include "dataset/readers.hpp"
#include "dataset/text_lines.hpp"

namespace weft::dataset {
namespace fs = std::filesystem;
namespace {

constexpr rgbd::CameraModel kKinect{640, 480, 525.0, 525.0, 319.5, 239.5};
constexpr double kTumDepthUnit_m = 1.0 / 5000.0;

std::int64_t at_30_hz(std::int64_t number) { return (number * 1'000'000 + 15) / 30; }

/// Files whose names are prefix, digits, suffix; by their number. Throws Error on two of one
/// number.
std::map<std::int64_t, std::string> numbered(const fs::path& folder, const std::string& prefix,
                                             const std::string& suffix) {
  std::map<std::int64_t, std::string> out;
  if (!fs::is_directory(folder)) return out;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.size() <= prefix.size() + suffix.size() || !name.starts_with(prefix) ||
        !name.ends_with(suffix))
      continue;
    const std::string digits =
        name.substr(prefix.size(), name.size() - prefix.size() - suffix.size());
    if (digits.size() > 12 || digits.find_first_not_of("0123456789") != std::string::npos) continue;
    if (!out.emplace(std::stoll(digits), entry.path().string()).second)
      throw Error(entry.path().string() + ": another file has the same number");
  }
  return out;
}

std::map<std::int64_t, std::string> first_of(
    std::initializer_list<std::map<std::int64_t, std::string>> choices) {
  for (const auto& each : choices)
    if (!each.empty()) return each;
  return {};
}

/// Colour and depth images of the same numbers. Throws Error when one is without the other.
void pair_up(const std::map<std::int64_t, std::string>& colour,
             const std::map<std::int64_t, std::string>& depth,
             const std::function<std::int64_t(std::int64_t)>& utime, Sequence& sequence) {
  for (const auto& [number, path] : colour) {
    const auto found = depth.find(number);
    if (found == depth.end()) throw Error(path + ": there is no depth image of this number");
    sequence.frames.push_back({utime(number), path, found->second});
  }
  for (const auto& [number, path] : depth)
    if (!colour.contains(number)) throw Error(path + ": there is no colour image of this number");
}

struct StampedFile {
  std::int64_t utime;
  std::string path;
};

std::vector<StampedFile> read_list(const fs::path& folder, const std::string& name) {
  const std::string path = (folder / name).string();
  const std::string text = read_text(path);
  std::vector<StampedFile> out;
  for (const auto& line : split_lines(text, path)) {
    if (line.words.size() < 2) throw Error(line.where + ": expected a time and a file");
    out.push_back({parse_stamp_us(line.words[0], line.where),
                   (folder / std::string(line.words[1])).string()});
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const auto& a, const auto& b) { return a.utime < b.utime; });
  return out;
}

rgbd::CameraModel tum_camera(const std::string& name) {
  if (name.find("freiburg1") != std::string::npos) return {640, 480, 517.3, 516.5, 318.6, 255.3};
  if (name.find("freiburg2") != std::string::npos) return {640, 480, 520.9, 521.0, 325.1, 249.7};
  if (name.find("freiburg3") != std::string::npos) return {640, 480, 535.4, 539.2, 320.1, 247.6};
  return kKinect;
}

void read_camera_yaml(const std::string& path, Sequence& sequence) {
  try {
    const YAML::Node node = YAML::LoadFile(path);
    sequence.camera = {node["width"].as<int>(), node["height"].as<int>(), node["fx"].as<double>(),
                       node["fy"].as<double>(), node["cx"].as<double>(),  node["cy"].as<double>()};
    sequence.depth_unit_m = 1.0 / node["depth_factor"].as<double>();
  } catch (const YAML::Exception& e) {
    throw Error(path + ": expected width, height, fx, fy, cx, cy and depth_factor: " + e.what());
  }
}

/// The file's "key: number".
double number_of(const std::string& text, const std::string& key, const std::string& where) {
  for (const auto& line : split_lines(text, where))
    if (line.words.size() >= 2 && line.words[0] == key + ":")
      return parse_number(line.words[1], line.where);
  throw Error(where + ": there is no " + key);
}

Sequence open_tum(const fs::path& folder) {
  Sequence s;
  s.kind = "tum";
  s.depth_unit_m = kTumDepthUnit_m;
  if (fs::exists(folder / "camera.yaml"))
    read_camera_yaml((folder / "camera.yaml").string(), s);
  else
    s.camera = tum_camera(fs::absolute(folder).lexically_normal().string());
  if (fs::exists(folder / "groundtruth.txt"))
    s.truth = read_trajectory((folder / "groundtruth.txt").string());
  const std::string list = (folder / "associations.txt").string();
  if (fs::exists(list)) {
    const std::string text = read_text(list);
    for (const auto& line : split_lines(text, list)) {
      if (line.words.size() < 4) throw Error(line.where + ": expected time, file, time, file");
      const std::int64_t utime = parse_stamp_us(line.words[0], line.where);
      const std::string a(line.words[1]), b(line.words[3]);
      const bool depth_first = a.find("depth") != std::string::npos;
      s.frames.push_back({depth_first ? parse_stamp_us(line.words[2], line.where) : utime,
                          (folder / (depth_first ? b : a)).string(),
                          (folder / (depth_first ? a : b)).string()});
    }
    return s;
  }
  // Closest first, each image once (the benchmark's associate.py): 20 ms apart at most.
  constexpr std::int64_t kMaxApart_us = 20'000;
  const auto colour = read_list(folder, "rgb.txt"), depth = read_list(folder, "depth.txt");
  struct Pair {
    std::int64_t apart_us;
    std::size_t colour, depth;
  };
  std::vector<Pair> pairs;
  std::size_t first = 0;
  for (std::size_t i = 0; i < colour.size(); ++i) {
    while (first < depth.size() && depth[first].utime < colour[i].utime - kMaxApart_us) ++first;
    for (std::size_t k = first; k < depth.size(); ++k) {
      const std::int64_t apart = depth[k].utime - colour[i].utime;
      if (apart > kMaxApart_us) break;
      pairs.push_back({std::abs(apart), i, k});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const Pair& a, const Pair& b) { return a.apart_us < b.apart_us; });
  std::vector<bool> used_colour(colour.size()), used_depth(depth.size());
  for (const Pair& pair : pairs) {
    if (used_colour[pair.colour] || used_depth[pair.depth]) continue;
    used_colour[pair.colour] = used_depth[pair.depth] = true;
    s.frames.push_back(
        {colour[pair.colour].utime, colour[pair.colour].path, depth[pair.depth].path});
  }
  return s;
}

Sequence open_cube_slam(const fs::path& folder) {
  Sequence s;
  s.kind = "cube_slam";
  const std::string settings = (folder / "TUM3.yaml").string();
  const std::string text = read_text(settings);
  const auto of = [&](const char* key) { return number_of(text, key, settings); };
  s.camera = {kKinect.width,   kKinect.height,  of("Camera.fx"),
              of("Camera.fy"), of("Camera.cx"), of("Camera.cy")};
  s.depth_unit_m = 1.0 / of("DepthMapFactor");
  s.truth = read_trajectory((folder / "truth_cam_poses.txt").string());
  pair_up(
      numbered(folder / "rgb", "", ".jpg"), numbered(folder / "depth", "", ".png"),
      [&](std::int64_t number) {
        if (number >= static_cast<std::int64_t>(s.truth.size()))
          throw Error((folder / "truth_cam_poses.txt").string() + ": there is no line for image " +
                      std::to_string(number));
        return s.truth[static_cast<std::size_t>(number)].utime;
      },
      s);
  return s;
}

Sequence open_7scenes(const fs::path& folder) {
  Sequence s;
  s.kind = "7scenes";
  s.camera = {640, 480, 585.0, 585.0, 320.0, 240.0};
  const std::string intrinsics = (folder / "camera-intrinsics.txt").string();
  if (fs::exists(intrinsics)) {
    const std::string text = read_text(intrinsics);
    const auto lines = split_lines(text, intrinsics);
    if (lines.size() < 2 || lines[0].words.size() < 3 || lines[1].words.size() < 3)
      throw Error(intrinsics + ": expected a matrix of 3 x 3 numbers");
    s.camera.fx = parse_number(lines[0].words[0], lines[0].where);
    s.camera.cx = parse_number(lines[0].words[2], lines[0].where);
    s.camera.fy = parse_number(lines[1].words[1], lines[1].where);
    s.camera.cy = parse_number(lines[1].words[2], lines[1].where);
  }
  pair_up(first_of(
              {numbered(folder, "frame-", ".color.png"), numbered(folder, "frame-", ".color.jpg")}),
          numbered(folder, "frame-", ".depth.png"), at_30_hz, s);
  for (const auto& [number, path] : numbered(folder, "frame-", ".pose.txt")) {
    const std::string text = read_text(path);
    const auto lines = split_lines(text, path);
    Eigen::Matrix4d m;
    if (lines.size() != 4) throw Error(path + ": expected a matrix of 4 x 4 numbers");
    for (int row = 0; row < 4; ++row) {
      const auto& line = lines[static_cast<std::size_t>(row)];
      if (line.words.size() != 4) throw Error(line.where + ": expected four numbers");
      for (int column = 0; column < 4; ++column)
        m(row, column) = parse_number(line.words[static_cast<std::size_t>(column)], line.where);
    }
    StampedPose pose;
    pose.utime = at_30_hz(number);
    pose.rotation_world_camera = Eigen::Quaterniond(Eigen::Matrix3d(m.topLeftCorner<3, 3>()));
    if (std::abs(pose.rotation_world_camera.norm() - 1.0) > 1e-2)
      throw Error(path + ": its rotation is none");
    pose.rotation_world_camera.normalize();
    pose.camera_in_world = m.topRightCorner<3, 1>();
    s.truth.push_back(pose);
  }
  return s;
}

std::map<std::int64_t, std::string> icl_colour(const fs::path& folder) {
  return first_of({numbered(folder / "image", "", ".jpg"), numbered(folder / "rgb", "", ".png")});
}

Sequence open_icl(const fs::path& folder) {
  Sequence s;
  s.kind = "icl";
  s.camera = kKinect;
  pair_up(icl_colour(folder), numbered(folder / "depth", "", ".png"), at_30_hz, s);
  const fs::path truth = folder / "groundtruth_keyframes_relative_to_frame0.txt";
  if (fs::exists(truth)) {
    s.truth = read_trajectory(truth.string());
    for (auto& pose : s.truth) pose.utime = at_30_hz(pose.utime / 1'000'000);  // numbers of frames
  }
  return s;
}

}  // namespace

rgbd::RgbdFrame Sequence::read(std::size_t index) const {
  const SequenceFrame& files = frames.at(index);
  rgbd::RgbdFrame frame;
  frame.camera = camera;
  frame.depth_unit_m = depth_unit_m;
  frame.source = name + "/" + fs::path(files.colour).filename().string();
  frame.colour = read_colour_image(files.colour);
  frame.depth = read_depth_image(files.depth);
  const cv::Size size(camera.width, camera.height);
  for (const auto& [image, path] :
       {std::pair(&frame.colour, &files.colour), std::pair(&frame.depth, &files.depth)})
    if (image->size() != size)
      throw Error(*path + ": " + std::to_string(image->cols) + " x " + std::to_string(image->rows) +
                  " px; the recording's camera has " + std::to_string(size.width) + " x " +
                  std::to_string(size.height));
  return frame;
}

std::string sequence_kind(const std::string& folder) {
  const fs::path path(folder);
  if (fs::exists(path / "truth_cam_poses.txt")) return "cube_slam";
  if (fs::exists(path / "rgb.txt") && fs::exists(path / "depth.txt")) return "tum";
  if (!numbered(path, "frame-", ".depth.png").empty()) return "7scenes";
  if (!numbered(path / "depth", "", ".png").empty() && !icl_colour(path).empty()) return "icl";
  return "";
}

Sequence open_sequence(const std::string& folder) {
  const fs::path path(folder);
  const std::string kind = sequence_kind(folder);
  Sequence s;
  if (kind == "cube_slam")
    s = open_cube_slam(path);
  else if (kind == "tum")
    s = open_tum(path);
  else if (kind == "7scenes")
    s = open_7scenes(path);
  else if (kind == "icl")
    s = open_icl(path);
  else
    throw Error(folder +
                ": no recording of a moving camera; looked for rgb.txt and depth.txt (TUM), "
                "truth_cam_poses.txt (cube_slam), frame-*.depth.png (7-Scenes), and numbered "
                "images in depth and image or rgb (ICL-NUIM)");
  s.name = fs::absolute(path).lexically_normal().filename().string();
  if (s.name.empty())
    s.name = fs::absolute(path).lexically_normal().parent_path().filename().string();
  if (s.frames.empty()) throw Error(folder + ": there are no pairs of a colour and a depth image");
  std::stable_sort(s.frames.begin(), s.frames.end(),
                   [](const auto& a, const auto& b) { return a.utime < b.utime; });
  for (std::size_t i = 1; i < s.frames.size(); ++i)
    if (s.frames[i].utime == s.frames[i - 1].utime)
      throw Error(s.frames[i].colour + ": another image has the same time");
  s.camera.validate(folder);
  if (!(s.depth_unit_m > 0.0) || !(s.depth_unit_m < 1.0))
    throw Error(folder + ": its depth unit of " + std::to_string(s.depth_unit_m) + " m is none");
  return s;
}

}  // namespace weft::dataset
