#include "slam/anchored_pose.hpp"

#include <algorithm>
#include <string>

#include "base/error.hpp"

namespace weft::slam {
namespace {

bool removes(const MapUpdate& update, Id key_frame) {
  if (update.from_version == 0)
    return std::none_of(update.new_key_frames.begin(), update.new_key_frames.end(),
                        [&](const KeyFrame& each) { return each.id == key_frame; });
  return std::find(update.removed_key_frames.begin(), update.removed_key_frames.end(), key_frame) !=
         update.removed_key_frames.end();
}

}  // namespace

AnchoredPose AnchoredPose::at(const Rigid3d& T_camera_world, const Map& map, Id reference) {
  const auto found = map.key_frames.find(reference);
  if (found == map.key_frames.end()) return {kNoId, T_camera_world};
  return {reference, T_camera_world * found->second.T_camera_world.inverse()};
}

Rigid3d AnchoredPose::T_camera_world(const Map& map) const {
  if (reference == kNoId) return T_camera_reference;
  const auto found = map.key_frames.find(reference);
  if (found == map.key_frames.end())
    throw Error("a pose is held by key frame " + std::to_string(reference) +
                ", which is not in the map");
  return T_camera_reference * found->second.T_camera_world;
}

void AnchoredPose::follow(const MapUpdate& update, const Map& before) {
  if (reference == kNoId || !removes(update, reference)) return;
  const Rigid3d pose = T_camera_world(before);
  Id next = before.key_frames.at(reference).parent;
  // No more steps than there are key frames: a circle of parents would be a faulty map.
  for (std::size_t steps = 0; steps < before.key_frames.size() && next != kNoId; ++steps) {
    if (!removes(update, next)) break;
    const auto found = before.key_frames.find(next);
    next = found == before.key_frames.end() ? kNoId : found->second.parent;
  }
  *this = at(pose, before, next != kNoId && removes(update, next) ? kNoId : next);
}

}  // namespace weft::slam
