#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <regex>

#include "base/error.hpp"
#include "dataset/readers.hpp"
#include "rgbd/pcd_io.hpp"

/// Folders of image pairs and of organised clouds.
namespace weft::dataset {
namespace {

namespace fs = std::filesystem;

/// The raw images of the UC3M set (github roboticslab-uc3m/textiles) are not registered. Fitted to
/// corners of the garments in three of its scenes, where it is good to 5 px: depth and colour
/// camera differ in focal length and sit side by side.
const std::regex kUc3mName("(\\d{8}_)?(\\d_)?[a-z]+\\d\\d_\\d[a-z]?_fold");
constexpr double kUc3mScale = 0.961;
constexpr double kUc3mOffsetPx[] = {-12.7, 3.6};

struct Pair {
  std::string name, colour, depth;
};

class PairDataset : public Dataset {
 public:
  PairDataset(const std::string& folder, std::vector<Pair> pairs, DatasetOptions options)
      : pairs_(std::move(pairs)),
        options_(std::move(options)),
        parts_(read_parts_file(folder + "/parts.json")) {
    for (const Pair& pair : pairs_) names_.push_back(pair.name);
  }
  const std::vector<std::string>& names() const override { return names_; }
  Scene read(std::size_t index) const override {
    const Pair& pair = pairs_.at(index);
    Scene scene = read_pair(pair.name, pair.colour, pair.depth, options_);
    add_parts(parts_, scene, [](cv::Point2f p) { return p; });
    return scene;
  }

 private:
  std::vector<Pair> pairs_;
  std::vector<std::string> names_;
  DatasetOptions options_;
  PartsFile parts_;
};

class CloudDataset : public Dataset {
 public:
  CloudDataset(std::string folder, std::vector<std::string> names, DatasetOptions options)
      : folder_(std::move(folder)),
        names_(std::move(names)),
        options_(std::move(options)),
        parts_(read_parts_file(folder_ + "/parts.json")) {}
  const std::vector<std::string>& names() const override { return names_; }
  Scene read(std::size_t index) const override {
    Scene scene = read_cloud(folder_ + "/" + names_.at(index) + ".pcd", options_);
    add_parts(parts_, scene, [](cv::Point2f p) { return p; });
    return scene;
  }

 private:
  std::string folder_;
  std::vector<std::string> names_;
  DatasetOptions options_;
  PartsFile parts_;
};

/// The depth image as DatasetOptions describe it, nearest neighbours; what comes in from outside is
/// missing.
cv::Mat registered(const cv::Mat& depth, double scale, const double* offset) {
  cv::Mat result(depth.size(), CV_16UC1, cv::Scalar(0));
  const double cx = (depth.cols - 1) / 2.0, cy = (depth.rows - 1) / 2.0;
  for (int v = 0; v < depth.rows; ++v) {
    const auto from_v = static_cast<int>(std::lround((v - cy + offset[1]) / scale + cy));
    if (from_v < 0 || from_v >= depth.rows) continue;
    for (int u = 0; u < depth.cols; ++u) {
      const auto from_u = static_cast<int>(std::lround((u - cx + offset[0]) / scale + cx));
      if (from_u >= 0 && from_u < depth.cols)
        result.at<std::uint16_t>(v, u) = depth.at<std::uint16_t>(from_v, from_u);
    }
  }
  return result;
}

/// X of X_rgb.png, frame-1.color.jpg
const std::regex kColourFile("(.*[^._-])([._-])(rgb|color|colour)\\.(png|jpe?g)");

bool is_image(const fs::path& path) {
  const std::string extension = path.extension();
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg";
}

}  // namespace

std::string scan_name(const std::string& path) {
  const fs::path file(path);
  const std::string name = file.filename();
  std::smatch match;
  return std::regex_match(name, match, kColourFile) ? match[1].str() : file.stem().string();
}

rgbd::CameraModel camera_from_options(int width, int height, const DatasetOptions& options,
                                      const std::string& where) {
  rgbd::CameraModel camera;
  camera.width = width;
  camera.height = height;
  camera.fx = options.fx_px > 0.0 ? options.fx_px : 525.0 * width / 640.0;
  camera.fy = options.fy_px > 0.0 ? options.fy_px : camera.fx;
  camera.cx = options.cx_px >= 0.0 ? options.cx_px : (width - 1) / 2.0;
  camera.cy = options.cy_px >= 0.0 ? options.cy_px : (height - 1) / 2.0;
  camera.validate(where);
  return camera;
}

std::string garment_of_name(const std::string& name) {
  constexpr std::pair<const char*, const char*> words[] = {
      {"polo", "polo"},      {"jean", "jeans"},  {"pants", "jeans"}, {"tshirt", "tshirt"},
      {"t-shirt", "tshirt"}, {"dress", "dress"}, {"shirt", "shirt"}, {"sweater", "sweater"},
      {"hoody", "sweater"},  {"towel", "towel"}, {"cloth", "towel"}, {"blanket", "blanket"},
  };
  for (const auto& [word, garment] : words)
    if (name.find(word) != std::string::npos) return garment;
  return "";
}

Scene read_pair(const std::string& name, const std::string& colour, const std::string& depth,
                const DatasetOptions& options) {
  Scene scene;
  scene.name = scene.simulation = name;
  scene.garment = garment_of_name(name);
  rgbd::RgbdFrame& frame = scene.frame;
  frame.source = name;
  frame.colour = read_colour_image(colour);
  frame.depth = read_depth_image(depth);
  frame.depth_unit_m = options.depth_unit_m;
  if (frame.colour.size() != frame.depth.size()) {
    throw Error(depth + ": " + std::to_string(frame.depth.cols) + "x" +
                std::to_string(frame.depth.rows) + " px, but the colour image " + colour + " has " +
                std::to_string(frame.colour.cols) + "x" + std::to_string(frame.colour.rows));
  }
  frame.camera = camera_from_options(frame.colour.cols, frame.colour.rows, options, depth);
  if (options.registration_offset_px.size() == 2) {
    frame.depth =
        registered(frame.depth, options.registration_scale, options.registration_offset_px.data());
  } else if (std::regex_match(name, kUc3mName)) {
    frame.depth = registered(frame.depth, kUc3mScale, kUc3mOffsetPx);
  }
  return scene;
}

Scene read_cloud(const std::string& path, const DatasetOptions& options) {
  const rgbd::Cloud cloud = rgbd::read_pcd(path);
  Scene scene;
  scene.name = scene.simulation = fs::path(path).stem();
  scene.garment = garment_of_name(scene.name);
  const rgbd::CameraModel camera =
      options.fx_px > 0.0 ? camera_from_options(cloud.width, cloud.height, options, path)
                          : rgbd::fit_camera(cloud, path).camera;
  scene.frame = rgbd::frame_from_cloud(cloud, camera, options.depth_unit_m, path);
  scene.frame.source = scene.name;
  return scene;
}

std::unique_ptr<Dataset> open_pairs(const std::string& folder, const DatasetOptions& options) {
  std::vector<Pair> pairs;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename();
    std::smatch match;
    if (std::regex_match(name, match, kColourFile))
      pairs.push_back(
          {match[1], entry.path(), folder + "/" + match[1].str() + match[2].str() + "depth.png"});
  }
  for (const char* colours : {"rgb", "color", "colour", "image"}) {
    const fs::path sub = fs::path(folder) / colours;
    if (!fs::is_directory(sub) || !fs::is_directory(fs::path(folder) / "depth")) continue;
    for (const auto& entry : fs::directory_iterator(sub)) {
      if (is_image(entry.path()))
        pairs.push_back({entry.path().stem(), entry.path(),
                         folder + "/depth/" + entry.path().stem().string() + ".png"});
    }
  }
  if (pairs.empty()) return nullptr;
  std::sort(pairs.begin(), pairs.end(),
            [](const Pair& a, const Pair& b) { return a.name < b.name; });
  return std::make_unique<PairDataset>(folder, std::move(pairs), options);
}

std::unique_ptr<Dataset> open_clouds(const std::string& folder, const DatasetOptions& options) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".pcd") names.push_back(entry.path().stem());
  if (names.empty()) return nullptr;
  std::sort(names.begin(), names.end());
  return std::make_unique<CloudDataset>(folder, std::move(names), options);
}

}  // namespace weft::dataset
