#include "mapping/map_export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "mapping/colours.hpp"

namespace weft::mapping {
namespace {

struct Vertex {
  Eigen::Vector3f point;
  Colour colour;
  std::int64_t label;
};

std::vector<Vertex> vertices(const MapContent& content) {
  std::vector<Vertex> out;
  for (const auto& [id, point] : content.map.points)
    out.push_back({point.position_world.cast<float>(), kPointColour, 0});
  for (const auto& pose : content.path)
    out.push_back({pose.camera_in_world.cast<float>(), kPathColour, 1});
  for (const auto& [id, plane] : content.map.planes)
    for (const auto& point : plane.cloud_world) out.push_back({point, plane_colour(id), 2 + id});
  return out;
}

nlohmann::json json_of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

nlohmann::json json_of(const Eigen::Quaterniond& q, const Eigen::Vector3d& t) {
  return {{"translation_m", json_of(t)}, {"rotation_wxyz", {q.w(), q.x(), q.y(), q.z()}}};
}

}  // namespace

std::vector<Eigen::Vector3d> outline(const slam::MapPlane& plane) {
  if (plane.cloud_world.size() < 3) return {};
  const auto [e0, e1] = plane::tangent_basis(plane.normal_world);
  struct Corner {
    double x, y;
  };
  std::vector<Corner> points;
  for (const auto& p : plane.cloud_world) {
    const Eigen::Vector3d point = p.cast<double>();
    points.push_back({e0.dot(point), e1.dot(point)});
  }
  std::sort(points.begin(), points.end(), [](const Corner& a, const Corner& b) {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
  });
  // Andrew's monotone chain.
  std::vector<Corner> hull;
  const auto turn = [](const Corner& a, const Corner& b, const Corner& c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
  };
  const auto walk = [&](auto first, auto last, std::size_t least) {
    for (auto it = first; it != last; ++it) {
      while (hull.size() > least && turn(hull[hull.size() - 2], hull.back(), *it) <= 0)
        hull.pop_back();
      hull.push_back(*it);
    }
  };
  walk(points.begin(), points.end(), 1);
  walk(points.rbegin() + 1, points.rend(), hull.size());
  hull.pop_back();  // the first again
  std::vector<Eigen::Vector3d> out;
  if (hull.size() < 3) return out;
  for (const auto& corner : hull)
    out.push_back(plane.normal_world * plane.distance_m + e0 * corner.x + e1 * corner.y);
  return out;
}

std::string to_ply(const MapContent& content) {
  const auto all = vertices(content);
  std::string out = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment world frame, metres\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar "
      "green\nproperty uchar blue\nend_header\n",
      all.size());
  for (const auto& v : all) {
    char bytes[15];
    for (int i = 0; i < 3; ++i) {
      std::uint32_t word;
      const float value = v.point[i];
      std::memcpy(&word, &value, 4);
      for (int byte = 0; byte < 4; ++byte)
        bytes[4 * i + byte] = static_cast<char>(word >> (8 * byte));
    }
    bytes[12] = static_cast<char>(v.colour.red);
    bytes[13] = static_cast<char>(v.colour.green);
    bytes[14] = static_cast<char>(v.colour.blue);
    out.append(bytes, sizeof bytes);
  }
  return out;
}

std::string to_pcd(const MapContent& content) {
  const auto all = vertices(content);
  std::string out = fmt::format(
      "# .PCD v0.7 - world frame, metres\nVERSION 0.7\nFIELDS x y z rgb label\nSIZE 4 4 4 4 4\n"
      "TYPE F F F U U\nCOUNT 1 1 1 1 1\nWIDTH {}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\n"
      "DATA ascii\n",
      all.size(), all.size());
  for (const auto& v : all)
    out += fmt::format("{} {} {} {} {}\n", v.point.x(), v.point.y(), v.point.z(),
                       v.colour.red << 16 | v.colour.green << 8 | v.colour.blue, v.label);
  return out;
}

std::string to_obj(const MapContent& content) {
  std::string out = "# world frame, metres\n";
  std::size_t next = 1;
  const auto vertex = [&](const Eigen::Vector3d& p) {
    out += fmt::format("v {:.6f} {:.6f} {:.6f}\n", p.x(), p.y(), p.z());
    return next++;
  };
  const auto element = [&](const char* kind, const std::vector<std::size_t>& numbers) {
    out += kind;
    for (const auto number : numbers) out += fmt::format(" {}", number);
    out += "\n";
  };
  for (const auto& [id, plane] : content.map.planes) {
    std::vector<std::size_t> face;
    const auto corners = outline(plane);
    if (corners.empty()) continue;
    out += fmt::format("o plane_{}\n", id);
    for (const auto& corner : corners) face.push_back(vertex(corner));
    element("f", face);
  }
  if (content.path.size() > 1) {
    out += "o camera_path\n";
    std::vector<std::size_t> line;
    for (const auto& pose : content.path) line.push_back(vertex(pose.camera_in_world));
    element("l", line);
  }
  if (!content.map.points.empty()) {
    out += "o points\n";
    std::vector<std::size_t> points;
    for (const auto& [id, point] : content.map.points)
      points.push_back(vertex(point.position_world));
    for (const auto number : points) element("p", {number});
  }
  for (const auto& garment : content.garments) {
    if (!garment.in_map) continue;
    out += fmt::format("o garment_{}\n", garment.id);
    element("p", {vertex(garment.position_world)});
    for (const auto& part : garment.parts) {
      std::string name = part.part;
      std::replace(name.begin(), name.end(), ' ', '_');
      out += fmt::format("o garment_{}_{}\n", garment.id, name);
      element("p", {vertex(part.position_world)});
    }
  }
  return out;
}

std::string to_json(const MapContent& content) {
  nlohmann::json json;
  json["version"] = content.map.version;
  json["key_frames"] = nlohmann::json::array();
  for (const auto& [id, k] : content.map.key_frames) {
    const auto T_world_camera = k.T_camera_world.inverse();
    json["key_frames"].push_back(
        {{"id", id},
         {"frame", k.frame},
         {"utime", k.utime},
         {"T_world_camera", json_of(T_world_camera.rotation, T_world_camera.translation)}});
  }
  json["points"] = nlohmann::json::array();
  for (const auto& [id, p] : content.map.points) {
    json["points"].push_back({{"id", id},
                              {"position_m", json_of(p.position_world)},
                              {"observations", p.observations.size()}});
  }
  json["planes"] = nlohmann::json::array();
  for (const auto& [id, p] : content.map.planes) {
    nlohmann::json corners = nlohmann::json::array();
    for (const auto& corner : outline(p)) corners.push_back(json_of(corner));
    nlohmann::json covariance = nlohmann::json::array();
    for (int row = 0; row < 3; ++row)
      covariance.push_back({p.covariance(row, 0), p.covariance(row, 1), p.covariance(row, 2)});
    json["planes"].push_back({{"id", id},
                              {"normal", json_of(p.normal_world)},
                              {"distance_m", p.distance_m},
                              {"covariance_tilt_tilt_distance", covariance},
                              {"sightings", p.sightings},
                              {"confirmed", p.confirmed},
                              {"voxels", p.cloud_world.size()},
                              {"outline_m", corners}});
  }
  json["garments"] = nlohmann::json::array();
  for (const auto& g : content.garments) {
    nlohmann::json parts = nlohmann::json::array();
    for (const auto& p : g.parts) {
      nlohmann::json part{{"part", p.part},
                          {"position_m", json_of(p.position_world)},
                          {"sigma_m", std::sqrt(p.covariance.trace() / 3.0)},
                          {"probability", p.probability},
                          {"sightings", p.sightings}};
      if (p.has_grasp)
        part["grasp"] = {{"score", p.grasp_score}, {"approach", json_of(p.approach_world)}};
      parts.push_back(std::move(part));
    }
    json["garments"].push_back({{"id", g.id},
                                {"in_map", g.in_map},
                                {"position_m", json_of(g.position_world)},
                                {"sigma_m", std::sqrt(g.covariance.trace() / 3.0)},
                                {"extent_m", g.extent_m},
                                {"supporting_plane", g.supporting_plane},
                                {"sightings", g.sightings},
                                {"parts", std::move(parts)}});
  }
  json["path"] = nlohmann::json::array();
  for (const auto& pose : content.path) {
    auto entry = json_of(pose.rotation_world_camera, pose.camera_in_world);
    entry["utime"] = pose.utime;
    json["path"].push_back(std::move(entry));
  }
  return json.dump(1) + "\n";
}

}  // namespace weft::mapping
