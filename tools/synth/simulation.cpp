#include "synth/simulation.hpp"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace weft::synth {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxElements = 4'000'000;  // vertices or faces; a garment has some thousands

struct Reader {
  std::string path;
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(path + ": " + what + "; is it a complete .wsim file of version 1?");
  }

  std::vector<Vec2> points(const json& list, const std::string& where) const {
    if (!list.is_array() || list.size() > 100'000) fail(where + " is not a list of points");
    std::vector<Vec2> out;
    for (const auto& p : list) {
      if (!p.is_array() || p.size() != 2) fail(where + ": a point is not [x, y]");
      const Vec2 v(p[0].get<float>(), p[1].get<float>());
      if (!(v.cwiseAbs().maxCoeff() < 100.0f)) fail(where + ": a coordinate is not within 100 m");
      out.push_back(v);
    }
    return out;
  }

  template <class T>
  std::vector<T> array(std::istream& in, const json& entry, std::size_t columns,
                       const char* dtype) const {
    const std::string name = entry.at("name");
    const auto shape = entry.at("shape").get<std::vector<std::size_t>>();
    if (entry.at("dtype") != dtype || shape.empty() || shape.size() > 2 ||
        (shape.size() == 2 ? shape[1] : 1) != columns || shape[0] > kMaxElements) {
      fail("array " + name + " has another type or shape than the format says");
    }
    std::vector<T> out(shape[0] * columns);
    in.read(reinterpret_cast<char*>(out.data()),
            static_cast<std::streamsize>(out.size() * sizeof(T)));
    if (!in) fail("array " + name + " ends early");
    return out;
  }
};

}  // namespace

Simulation read_simulation(const std::string& path) {
  const Reader reader{path};
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(path + ": cannot be opened; check the folder of simulations");
  std::string line;
  if (!std::getline(in, line)) reader.fail("the JSON line is missing");
  Simulation s;
  s.name = std::filesystem::path(path).stem().string();
  try {
    const json header = json::parse(line);
    if (header.at("format") != "weft-sim" || header.at("version") != 1) {
      reader.fail("format or version is another one");
    }
    s.seed = header.at("seed");
    s.index = header.at("index");
    s.generator = header.at("generator");
    s.garment = header.at("garment");
    s.state = header.at("state");
    s.cut = header.at("cut").dump();
    s.held_out = header.at("split_cut") == "held-out";
    s.turned_over = header.at("turned_over");
    s.wrinkledness_deg = header.at("wrinkledness");
    std::map<std::string, int> panel_index;
    for (const auto& p : header.at("panels")) {
      panel_index[p.at("name")] = static_cast<int>(s.panels.size());
      s.panels.push_back({p.at("name"), p.at("side"), p.at("layer")});
    }
    if (s.panels.empty() || s.panels.size() > 64) reader.fail("panels: none, or more than 64");
    const auto panel_of = [&](const json& object, const std::string& where) {
      const auto found = panel_index.find(object.at("panel"));
      if (found == panel_index.end()) reader.fail(where + ": unknown panel");
      return found->second;
    };
    const json& edges = header.at("edges");
    const auto edge_of = [&](const json& object, const std::string& where) {
      const std::string name = object.at("edge"), panel = object.at("panel");
      if (!edges.contains(name) || !edges[name].contains(panel)) {
        reader.fail(where + ": panel " + panel + " has no edge " + name);
      }
      return reader.points(edges[name][panel], "edges." + name + "." + panel);
    };
    for (const auto& p : header.at("parts")) {
      PartInstance part{p.at("part"), p.at("instance"), {}};
      const std::string where = "part " + part.part;
      for (const auto& r : p.at("regions")) {
        PartRegion region;
        region.panel = panel_of(r, where);
        region.is_line = r.contains("edge");
        region.points = region.is_line ? edge_of(r, where) : reader.points(r.at("polygon"), where);
        if (region.is_line) region.width_m = r.at("width_m");
        part.regions.push_back(std::move(region));
      }
      s.parts.push_back(std::move(part));
    }
    if (s.parts.size() > 30) reader.fail("more than 30 part instances");
    for (const auto& f : header.at("features")) {
      Feature feature;
      feature.kind = f.at("kind");
      const std::string where = "feature " + feature.kind;
      feature.panel = panel_of(f, where);
      if (f.contains("polygon")) {
        feature.points = reader.points(f["polygon"], where);
      } else if (f.contains("polyline")) {
        feature.points = reader.points(f["polyline"], where);
      } else if (f.contains("edge")) {
        feature.points = edge_of(f, where);
      } else if (f.contains("center")) {
        feature.points = reader.points(json::array({f["center"]}), where);
      }
      if (feature.points.empty()) reader.fail(where + ": nothing says where it is");
      feature.width_m = f.value("width_m", 0.0f);
      feature.offset_m = f.value("offset_m", 0.0f);
      feature.radius_m = f.value("radius_m", 0.0f);
      feature.height_m = f.value("height_m", 0.0f);
      feature.inside = f.value("face", "") == "inside";
      feature.outside = f.value("face", "") == "outside";
      s.features.push_back(std::move(feature));
    }
    for (const auto& a : header.at("arrays")) {
      const std::string name = a.at("name");
      if (name == "pattern") {
        const auto v = reader.array<float>(in, a, 2, "f4");
        for (std::size_t i = 0; i < v.size(); i += 2) s.pattern.emplace_back(v[i], v[i + 1]);
      } else if (name == "pose") {
        const auto v = reader.array<float>(in, a, 3, "f4");
        for (std::size_t i = 0; i < v.size(); i += 3) s.pose.emplace_back(v[i], v[i + 1], v[i + 2]);
      } else if (name == "faces") {
        const auto v = reader.array<std::int32_t>(in, a, 3, "i4");
        for (std::size_t i = 0; i < v.size(); i += 3) s.faces.push_back({v[i], v[i + 1], v[i + 2]});
      } else if (name == "panel") {
        s.panel_of_face = reader.array<std::uint8_t>(in, a, 1, "u1");
      } else {
        reader.fail("unknown array " + name);
      }
    }
  } catch (const json::exception& e) {
    reader.fail(std::string("JSON line: ") + e.what());
  }
  if (s.pose.empty() || s.pose.size() != s.pattern.size()) {
    reader.fail("pose and pattern differ in length or are empty");
  }
  if (s.faces.empty() || s.faces.size() != s.panel_of_face.size()) {
    reader.fail("faces and panel differ in length or are empty");
  }
  const auto bounded = [](const auto& v) { return v.cwiseAbs().maxCoeff() < 100.0f; };
  for (std::size_t i = 0; i < s.pose.size(); ++i) {
    if (!s.pose[i].allFinite() || !s.pattern[i].allFinite() || !bounded(s.pose[i]) ||
        !bounded(s.pattern[i])) {
      reader.fail("vertex " + std::to_string(i) + " is not a finite point within 100 m");
    }
  }
  for (std::size_t i = 0; i < s.faces.size(); ++i) {
    for (const int v : s.faces[i]) {
      if (v < 0 || static_cast<std::size_t>(v) >= s.pose.size()) {
        reader.fail("face " + std::to_string(i) + " names a vertex that is not there");
      }
    }
    if (s.panel_of_face[i] >= s.panels.size()) {
      reader.fail("face " + std::to_string(i) + " names a panel that is not there");
    }
  }
  return s;
}

void write_simulation(const std::string& path, const Simulation& s) {
  const auto points = [](const std::vector<Vec2>& list) {
    json out = json::array();
    for (const auto& p : list) out.push_back({p.x(), p.y()});
    return out;
  };
  json header = {{"format", "weft-sim"},
                 {"version", 1},
                 {"seed", s.seed},
                 {"index", s.index},
                 {"generator", s.generator},
                 {"garment", s.garment},
                 {"split_cut", s.held_out ? "held-out" : "seen"},
                 {"cut", json::parse(s.cut)},
                 {"state", s.state},
                 {"turned_over", s.turned_over},
                 {"wrinkledness", s.wrinkledness_deg},
                 {"quality", json::object()},
                 {"edges", json::object()},
                 {"panels", json::array()},
                 {"parts", json::array()},
                 {"features", json::array()}};
  for (const auto& p : s.panels) {
    header["panels"].push_back({{"name", p.name}, {"side", p.side}, {"layer", p.layer}});
  }
  int edge = 0;
  for (const auto& p : s.parts) {
    json regions = json::array();
    for (const auto& r : p.regions) {
      const std::string panel = s.panels.at(static_cast<std::size_t>(r.panel)).name;
      if (r.is_line) {
        const std::string name = "edge_" + std::to_string(edge++);
        header["edges"][name][panel] = points(r.points);
        regions.push_back({{"panel", panel}, {"edge", name}, {"width_m", r.width_m}});
      } else {
        regions.push_back({{"panel", panel}, {"polygon", points(r.points)}});
      }
    }
    header["parts"].push_back({{"part", p.part}, {"instance", p.instance}, {"regions", regions}});
  }
  for (const auto& f : s.features) {
    json object = {{"kind", f.kind},
                   {"panel", s.panels.at(static_cast<std::size_t>(f.panel)).name},
                   {"width_m", f.width_m},
                   {"offset_m", f.offset_m},
                   {"height_m", f.height_m}};
    if (f.radius_m > 0.0f) {
      object["radius_m"] = f.radius_m;
      object["center"] = {f.points[0].x(), f.points[0].y()};
    } else {
      object["polyline"] = points(f.points);
    }
    if (f.inside || f.outside) object["face"] = f.inside ? "inside" : "outside";
    header["features"].push_back(object);
  }
  const auto array = [](const char* name, const char* dtype, std::size_t rows, int columns) {
    json shape = {rows};
    if (columns > 1) shape.push_back(columns);
    return json{{"name", name}, {"dtype", dtype}, {"shape", shape}};
  };
  header["arrays"] = {
      array("pattern", "f4", s.pattern.size(), 2), array("pose", "f4", s.pose.size(), 3),
      array("faces", "i4", s.faces.size(), 3), array("panel", "u1", s.panel_of_face.size(), 1)};
  std::ofstream out(path, std::ios::binary);
  out << header.dump() << '\n';
  const auto raw = [&](const auto& v) {
    out.write(reinterpret_cast<const char*>(v.data()),
              static_cast<std::streamsize>(v.size() * sizeof(v[0])));
  };
  raw(s.pattern);
  raw(s.pose);
  raw(s.faces);
  raw(s.panel_of_face);
  out.close();
  if (!out) throw Error(path + ": cannot be written; check the folder and the free space");
}

}  // namespace weft::synth
