#include "messages/map_objects.hpp"

#include <algorithm>
#include <cmath>

#include "messages/map.hpp"
#include "messages/planes.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

void copy(const Eigen::Vector3d& from, double (&to)[3]) { std::copy_n(from.data(), 3, to); }

Eigen::Vector3d position(const double (&values)[3], const std::string& where) {
  Eigen::Vector3d v = Eigen::Map<const Eigen::Vector3d>(values);
  if (!v.allFinite()) throw stage::InvalidInput(where + ": a position is not finite");
  return v;
}

double share(double value, const std::string& where, const char* what) {
  if (!(value >= 0.0 && value <= 1.0))
    throw stage::InvalidInput(where + ": a " + what + " outside 0 to 1");
  return value;
}

int counted(std::int32_t value, const std::string& where) {
  if (value < 0) throw stage::InvalidInput(where + ": a count below 0");
  return value;
}

map_part_t to_message(const slam::GarmentPart& part,
                      const std::optional<slam::Rigid3d>& T_base_world) {
  map_part_t out{};
  out.part = part.part;
  copy(part.position_world, out.position_world_m);
  to_triangle(part.covariance, out.covariance);
  out.probability = part.probability;
  out.sightings = part.sightings;
  out.has_grasp = part.has_grasp ? 1 : 0;
  out.grasp_score = part.grasp_score;
  copy(part.approach_world, out.approach_world);
  if (T_base_world) {
    copy(*T_base_world * part.position_world, out.position_base_m);
    copy(T_base_world->rotation * part.approach_world, out.approach_base);
  }
  return out;
}

slam::GarmentPart from_message(const map_part_t& in, const std::string& garment) {
  slam::GarmentPart part;
  part.part = in.part;
  const std::string where = garment + ", part '" + in.part + "'";
  part.position_world = position(in.position_world_m, where);
  part.covariance = from_triangle(in.covariance, where);
  part.probability = share(in.probability, where, "probability");
  part.sightings = counted(in.sightings, where);
  part.has_grasp = in.has_grasp != 0;
  part.grasp_score = share(in.grasp_score, where, "grasp score");
  part.approach_world = Eigen::Map<const Eigen::Vector3d>(in.approach_world);
  if (!(std::abs(part.approach_world.norm() - 1.0) <= 1e-6))
    throw stage::InvalidInput(where + ": an approach that is not of unit length");
  return part;
}

}  // namespace

void to_message(const MapObjectsContent& content, map_objects_t& message) {
  message.map_id = content.map_id;
  message.map_version = content.map_version;
  message.has_base = content.T_base_world ? 1 : 0;
  message.T_base_world = to_message(content.T_base_world.value_or(slam::Rigid3d{}));
  message.objects.clear();
  for (const slam::Garment& garment : content.garments) {
    map_object_t out{};
    out.id = garment.id;
    out.in_map = garment.in_map ? 1 : 0;
    copy(garment.position_world, out.position_world_m);
    to_triangle(garment.covariance, out.covariance);
    out.extent_m = garment.extent_m;
    out.supporting_plane = garment.supporting_plane;
    out.sightings = garment.sightings;
    out.consecutive = garment.consecutive;
    out.missed = garment.missed;
    if (content.T_base_world)
      copy(*content.T_base_world * garment.position_world, out.position_base_m);
    for (const auto& part : garment.parts)
      out.parts.push_back(to_message(part, content.T_base_world));
    out.part_count = static_cast<std::int32_t>(out.parts.size());
    message.objects.push_back(std::move(out));
  }
  message.object_count = static_cast<std::int32_t>(message.objects.size());
}

MapObjectsContent from_message(const map_objects_t& message) {
  MapObjectsContent content;
  content.map_id = message.map_id;
  content.map_version = message.map_version;
  if (content.map_id < 0 || content.map_version < 0)
    throw stage::InvalidInput("MAP_OBJECTS: a map id or version below 0");
  if (message.has_base != 0)
    content.T_base_world = from_message(message.T_base_world, "MAP_OBJECTS: T_base_world");
  slam::Id last = -1;
  for (const map_object_t& in : message.objects) {
    const std::string where = "MAP_OBJECTS: garment " + std::to_string(in.id);
    if (in.id <= last) throw stage::InvalidInput(where + ": ids do not ascend from 0");
    last = in.id;
    slam::Garment garment;
    garment.id = in.id;
    garment.in_map = in.in_map != 0;
    garment.position_world = position(in.position_world_m, where);
    garment.covariance = from_triangle(in.covariance, where);
    garment.extent_m = in.extent_m;
    if (!(in.extent_m >= 0.0 && in.extent_m <= 100.0))
      throw stage::InvalidInput(where + ": an extent outside 0 to 100 m");
    garment.supporting_plane = in.supporting_plane;
    if (in.supporting_plane < slam::kNoId)
      throw stage::InvalidInput(where + ": a supporting plane that is no id");
    garment.sightings = counted(in.sightings, where);
    garment.consecutive = counted(in.consecutive, where);
    garment.missed = counted(in.missed, where);
    for (const auto& part : in.parts) garment.parts.push_back(from_message(part, where));
    content.garments.push_back(std::move(garment));
  }
  return content;
}

}  // namespace weft::messages
