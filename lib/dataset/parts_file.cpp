#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "dataset/readers.hpp"

namespace weft::dataset {
namespace {

using nlohmann::json;

std::vector<cv::Point2f> polygon_of(const json& points, const std::string& where) {
  std::vector<cv::Point2f> polygon;
  if (points.is_array()) {
    for (const json& point : points) {
      if (!point.is_array() || point.size() != 2 || !point[0].is_number() || !point[1].is_number())
        throw Error(where + ": a point of a polygon must be [x, y]");
      const cv::Point2f p(point[0].get<float>(), point[1].get<float>());
      if (!(std::abs(p.x) < 1e5f && std::abs(p.y) < 1e5f))
        throw Error(where + ": a point is far outside any image");
      polygon.push_back(p);
    }
  }
  if (polygon.size() < 3) throw Error(where + ": a polygon must have three points or more");
  return polygon;
}

}  // namespace

PartsFile read_parts_file(const std::string& path) {
  PartsFile file;
  if (!std::filesystem::exists(path)) return file;
  json root;
  try {
    std::ifstream in(path);
    root = json::parse(in);
  } catch (const json::exception& e) {
    throw Error(path + ": not valid JSON: " + e.what());
  }
  if (!root.is_object() || !root.contains("scenes") || !root["scenes"].is_object())
    throw Error(path + ": an object \"scenes\" is missing");
  for (const auto& [name, parts] : root["scenes"].items()) {
    PartsFile::SceneParts& scene = file.scenes[name];
    const std::string where = path + ": scene " + name;
    if (!parts.is_object()) throw Error(where + " must hold an object of parts");
    for (const auto& [part, polygons] : parts.items()) {
      if (part == "ignore") {
        if (!polygons.is_object()) throw Error(where + ": \"ignore\" must be {part: reason}");
        for (const auto& [ignored, reason] : polygons.items()) scene.ignored.push_back(ignored);
        continue;
      }
      if (!polygons.is_array())
        throw Error(where + ", part " + part + ": a list of polygons is expected");
      for (const json& points : polygons) {
        PartPolygon polygon;
        polygon.part = part;
        polygon.instance = polygons.size() > 1 ? std::to_string(scene.polygons.size()) : "";
        polygon.points = polygon_of(points, where + ", part " + part);
        scene.polygons.push_back(std::move(polygon));
      }
    }
  }
  return file;
}

void add_parts(const PartsFile& parts, Scene& scene,
               const std::function<cv::Point2f(cv::Point2f)>& to_frame) {
  const auto found = parts.scenes.find(scene.name);
  if (found == parts.scenes.end()) return;
  for (PartPolygon polygon : found->second.polygons) {
    for (cv::Point2f& p : polygon.points) p = to_frame(p);
    scene.polygons.push_back(std::move(polygon));
  }
  for (const std::string& part : found->second.ignored) {
    PartPolygon polygon;
    polygon.part = part;
    polygon.ignore = true;
    polygon.points = scene.outline;
    if (polygon.points.empty()) {
      const auto right = static_cast<float>(scene.frame.camera.width - 1);
      const auto bottom = static_cast<float>(scene.frame.camera.height - 1);
      polygon.points = {{0, 0}, {right, 0}, {right, bottom}, {0, bottom}};
    }
    scene.polygons.push_back(std::move(polygon));
  }
}

}  // namespace weft::dataset
