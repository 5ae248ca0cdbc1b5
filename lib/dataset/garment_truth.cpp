#include "dataset/garment_truth.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"

namespace weft::dataset {
namespace {

using nlohmann::json;

std::string text_of(const json& object, const char* key, const std::string& where) {
  if (!object.contains(key) || !object[key].is_string())
    throw Error(where + ": \"" + key + "\" must be a text");
  return object[key].get<std::string>();
}

Eigen::Vector3d position_of(const json& object, const std::string& where) {
  const json values = object.value("position_m", json());
  Eigen::Vector3d out;
  bool good = values.is_array() && values.size() == 3;
  for (int i = 0; good && i < 3; ++i) {
    const json& value = values[static_cast<std::size_t>(i)];
    good = value.is_number();
    if (good) out[i] = value.get<double>();
    good = good && std::abs(out[i]) < 1e6;
  }
  if (!good) throw Error(where + ": \"position_m\" must be [x, y, z] in metres");
  return out;
}

const json& list_of(const json& object, const char* key, const std::string& where) {
  if (!object.is_object() || !object.contains(key) || !object[key].is_array())
    throw Error(where + ": a list \"" + key + "\" is missing");
  return object[key];
}

}  // namespace

std::vector<TrueGarment> parse_garment_truth(std::string_view text, const std::string& where) {
  json root;
  try {
    root = json::parse(text);
  } catch (const json::exception& e) {
    throw Error(where + ": not valid JSON: " + e.what());
  }
  std::vector<TrueGarment> out;
  for (const json& each : list_of(root, "garments", where)) {
    const std::string garment_where = where + ": garment " + std::to_string(out.size());
    TrueGarment garment;
    const json& parts = list_of(each, "parts", garment_where);
    garment.garment = text_of(each, "garment", garment_where);
    garment.position_world = position_of(each, garment_where);
    for (const json& entry : parts) {
      const std::string part_where =
          garment_where + ", part " + std::to_string(garment.parts.size());
      if (!entry.is_object()) throw Error(part_where + ": must be an object");
      TruePart part;
      part.part = text_of(entry, "part", part_where);
      part.instance = text_of(entry, "instance", part_where);
      part.position_world = position_of(entry, part_where);
      const json share = entry.value("seen_share", json());
      if (!share.is_number() || !(share.get<double>() >= 0.0 && share.get<double>() <= 1.0))
        throw Error(part_where + ": \"seen_share\" must be a number from 0 to 1");
      part.seen_share = share.get<double>();
      garment.parts.push_back(std::move(part));
    }
    out.push_back(std::move(garment));
  }
  return out;
}

std::vector<TrueGarment> read_garment_truth(const std::string& path) {
  return parse_garment_truth(read_text_file(path), path);
}

}  // namespace weft::dataset
