#include "dataset/plane_scans.hpp"

#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "dataset/readers.hpp"
#include "dataset/text_lines.hpp"

namespace weft::dataset {
namespace fs = std::filesystem;
namespace {

constexpr rgbd::CameraModel kIcl{640, 480, 481.2, 480.0, 319.5, 239.5};

rgbd::CameraModel read_matrix(const std::string& path) {
  const std::string text = read_text(path);
  const auto lines = split_lines(text, path);
  if (lines.size() < 2 || lines[0].words.size() < 3 || lines[1].words.size() < 3)
    throw Error(path + ": expected a matrix of 3 x 3 numbers");
  rgbd::CameraModel camera{kIcl.width, kIcl.height, 0, 0, 0, 0};
  camera.fx = std::abs(parse_number(lines[0].words[0], lines[0].where));
  camera.cx = parse_number(lines[0].words[2], lines[0].where);
  camera.fy = std::abs(parse_number(lines[1].words[1], lines[1].where));
  camera.cy = parse_number(lines[1].words[2], lines[1].where);
  return camera;
}

/// Plain files as well: zlib passes them through.
std::string read_gzip(const std::string& path) {
  constexpr std::size_t kMaxBytes = 64u << 20;
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(gzopen(path.c_str(), "rb"), gzclose);
  if (!file) throw Error(path + ": cannot be opened as a file");
  std::string text;
  char buffer[1 << 16];
  for (;;) {
    const int read = gzread(file.get(), buffer, sizeof buffer);
    if (read < 0) throw Error(path + ": damaged or no gzip file");
    if (read == 0) break;
    text.append(buffer, static_cast<std::size_t>(read));
    if (text.size() > kMaxBytes) throw Error(path + ": holds more than 64 MB");
  }
  return text;
}

/// Counts of depth_unit_m along the optical axis.
cv::Mat read_ray_distances(const PlaneScanFile& file) {
  const std::string text = read_gzip(file.depth);
  const auto& camera = file.camera;
  cv::Mat depth(camera.height, camera.width, CV_16UC1, cv::Scalar(0));
  int at = 0;
  for (const auto& line : split_lines(text, file.depth)) {
    for (const auto word : line.words) {
      if (at >= camera.width * camera.height) throw Error(line.where + ": too many numbers");
      const int u = at % camera.width, v = at / camera.width;
      ++at;
      const double counts = 0.01 * parse_number(word, line.where) /
                            camera.unproject(u, v, 1.0).norm() / file.depth_unit_m;
      if (counts >= 1.0 && counts < 65535.0)
        depth.at<std::uint16_t>(v, u) = static_cast<std::uint16_t>(counts + 0.5);
    }
  }
  if (at != camera.width * camera.height)
    throw Error(file.depth + ": " + std::to_string(at) + " numbers, expected " +
                std::to_string(camera.width * camera.height));
  return depth;
}

/// One colour a plane, black for none.
cv::Mat read_labels(const std::string& path) {
  const cv::Mat image = read_colour_image(path);
  cv::Mat labels(image.size(), CV_8UC1, cv::Scalar(0));
  std::map<int, int> numbers;
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u) {
      const auto& px = image.at<cv::Vec3b>(v, u);
      const int colour = px[0] | px[1] << 8 | px[2] << 16;
      if (colour == 0) continue;
      const int number =
          numbers.emplace(colour, static_cast<int>(numbers.size()) + 1).first->second;
      if (number > 255) throw Error(path + ": more than 255 colours; one a plane is expected");
      labels.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(number);
    }
  return labels;
}

void list(const fs::path& folder, std::vector<PlaneScanFile>& out) {
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::string matrix;
  for (const auto& path : paths)
    if (path.extension() == ".K") matrix = path.string();
  const auto truth_of = [&](const std::string& name) {
    const fs::path path = folder / ("planes_" + name + ".png");
    return fs::exists(path) ? path.string() : "";
  };
  for (const auto& path : paths) {
    if (fs::is_directory(path)) {
      list(path, out);
      continue;
    }
    PlaneScanFile file;
    file.depth = path.string();
    std::string name = path.filename().string();
    file.name = (folder.filename() / name).string();
    if (name.starts_with("depth_") && name.ends_with(".png")) {
      if (matrix.empty())
        throw Error(path.string() + ": there is no camera matrix (*.K) beside it");
      file.truth = truth_of(name.substr(6, name.size() - 10));
      file.camera = read_matrix(matrix);
    } else if (name.ends_with(".depth") || name.ends_with(".depth.gz")) {
      file.truth = truth_of(name.substr(0, name.find(".depth")));
      file.camera = kIcl;
      file.along_ray_cm = true;
    } else {
      continue;
    }
    out.push_back(std::move(file));
  }
}

}  // namespace

std::vector<PlaneScanFile> list_plane_scans(const std::string& folder) {
  if (!fs::is_directory(folder)) throw Error(folder + ": is no folder");
  std::vector<PlaneScanFile> files;
  list(folder, files);
  if (files.empty())
    throw Error(folder +
                ": no depth images; looked for depth_*.png with planes_*.png and *.K, and "
                "for *.depth and *.depth.gz with planes_*.png");
  return files;
}

PlaneScan read_plane_scan(const PlaneScanFile& file) {
  PlaneScan scan;
  scan.name = file.name;
  scan.frame.camera = file.camera;
  scan.frame.camera.validate(file.depth);
  scan.frame.depth_unit_m = file.depth_unit_m;
  scan.frame.source = file.name;
  scan.frame.depth = file.along_ray_cm ? read_ray_distances(file) : read_depth_image(file.depth);
  const cv::Size size(file.camera.width, file.camera.height);
  if (scan.frame.depth.size() != size) throw Error(file.depth + ": is not 640 x 480 px");
  if (!file.truth.empty()) {
    scan.truth = read_labels(file.truth);
    if (scan.truth.size() != size) throw Error(file.truth + ": is not of its depth image's size");
  }
  return scan;
}

}  // namespace weft::dataset
