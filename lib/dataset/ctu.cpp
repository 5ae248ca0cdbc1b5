#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "dataset/readers.hpp"

/// CTU Color and Depth Image Dataset of Spread Garments (Wagner, Krejcova: CTU-CMP-2013-25).
/// cloA*.yaml names the colour (1280x1024) and the depth (640x480, mm) image and holds the outline
/// as a polygon in colour px. Neither registration nor intrinsics come with the set. Measured: the
/// depth fits the centred 1280x960 crop of the colour image at half its size, to a few px.
namespace weft::dataset {
namespace {

namespace fs = std::filesystem;

/// The set's garment types under our names.
std::string garment_of_type(const std::string& type) {
  static const std::map<std::string, std::string> names = {
      {"pants", "jeans"},        {"polo", "polo"},     {"polo-long", "polo"}, {"tshirt", "tshirt"},
      {"tshirt-long", "tshirt"}, {"hoody", "sweater"}, {"bluse", "shirt"},    {"towel", "towel"},
  };
  const auto found = names.find(type);
  return found == names.end() ? "" : found->second;
}

class CtuDataset : public Dataset {
 public:
  CtuDataset(std::string folder, std::vector<std::string> names)
      : folder_(std::move(folder)),
        names_(std::move(names)),
        parts_(read_parts_file(folder_ + "/parts.json")) {}

  const std::vector<std::string>& names() const override { return names_; }

  Scene read(std::size_t index) const override {
    const std::string path = folder_ + "/cloA" + names_.at(index) + ".yaml";
    Scene scene;
    scene.name = scene.simulation = names_[index];
    std::string colour_path, depth_path;
    std::vector<cv::Point2f> outline;
    try {
      const YAML::Node yaml = YAML::LoadFile(path);
      colour_path = file_name(yaml, "path_c", path);
      depth_path = file_name(yaml, "path_d", path);
      scene.garment = garment_of_type(yaml["type"].as<std::string>(""));
      for (const YAML::Node& point : yaml["poly_c"]) {
        outline.emplace_back(point[0].as<float>(), point[1].as<float>());
        if (!std::isfinite(outline.back().x) || !std::isfinite(outline.back().y))
          throw Error(path + ": poly_c holds a number that is not finite");
      }
    } catch (const YAML::Exception& e) {
      throw Error(path + ": " + e.what());
    }
    const cv::Mat colour = read_colour_image(colour_path);
    rgbd::RgbdFrame& frame = scene.frame;
    frame.depth = read_depth_image(depth_path);
    const int width = frame.depth.cols, height = frame.depth.rows;
    const int top = (colour.rows - 2 * height) / 2;
    if (colour.cols != 2 * width || top < 0) {
      throw Error(colour_path + ": " + std::to_string(colour.cols) + "x" +
                  std::to_string(colour.rows) + " px do not hold a " + std::to_string(2 * width) +
                  "x" + std::to_string(2 * height) + " crop, twice the size of the depth image " +
                  depth_path);
    }
    cv::resize(colour(cv::Rect(0, top, 2 * width, 2 * height)), frame.colour, {width, height}, 0, 0,
               cv::INTER_AREA);
    frame.camera = camera_from_options(width, height, {}, path);
    frame.source = scene.name;
    const auto to_frame = [top](cv::Point2f p) {
      return cv::Point2f((p.x - 0.5f) / 2, (p.y - static_cast<float>(top) - 0.5f) / 2);
    };
    std::transform(outline.begin(), outline.end(), std::back_inserter(scene.outline), to_frame);
    add_parts(parts_, scene, to_frame);
    return scene;
  }

 private:
  /// A plain file name in the same folder: a data set cannot name files elsewhere.
  std::string file_name(const YAML::Node& yaml, const char* key, const std::string& path) const {
    const auto name = yaml[key].as<std::string>("");
    if (name.empty() || fs::path(name).filename() != name)
      throw Error(path + ": " + key + " must be the name of an image beside this file, not \"" +
                  name + "\"");
    return folder_ + "/" + name;
  }

  std::string folder_;
  std::vector<std::string> names_;
  PartsFile parts_;
};

}  // namespace

std::unique_ptr<Dataset> open_ctu(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string stem = entry.path().stem();
    if (entry.path().extension() == ".yaml" && stem.rfind("cloA", 0) == 0)
      names.push_back(stem.substr(4));
  }
  if (names.empty()) return nullptr;
  std::sort(names.begin(), names.end());
  return std::make_unique<CtuDataset>(folder, std::move(names));
}

}  // namespace weft::dataset
