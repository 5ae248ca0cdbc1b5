#include "mapping/map_log.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <set>

#include "base/error.hpp"
#include "messages/map.hpp"
#include "messages/map_objects.hpp"
#include "slam/map_history.hpp"
#include "stage/log.hpp"
#include "stage/stage.hpp"
#include "weft/rgbd_frame_t.hpp"

namespace weft::mapping {
namespace {

template <class Message>
std::shared_ptr<Message> decode(const stage::LogEvent& event) {
  static const auto type = stage::message_type<Message>();
  std::shared_ptr<void> message;
  try {
    message = type.decode(event.data.data(), static_cast<int>(event.data.size()));
  } catch (const std::exception&) {
    // lcm-gen's decoders throw on a string of length 0.
  }
  if (!message)
    throw Error(event.channel + ": event " + std::to_string(event.number) + " is no " + type.name +
                " of this build");
  return std::static_pointer_cast<Message>(message);
}

bool usable(const status_t& status) {
  return status.code == status_t::OK || status.code == status_t::NOTHING;
}

class Reader {
 public:
  explicit Reader(MapLog& out) : out_(out) {}

  void take(const camera_pose_t& message) {
    if (!usable(message.status) || !seen_.insert(message.header.seq).second) return;
    const auto content = messages::from_message(message);
    LoggedPose pose{content.tracked, content.map_id, {}};
    pose.anchor =
        out_.map.key_frames.contains(content.tracked.reference)
            ? slam::AnchoredPose{content.tracked.reference, content.tracked.T_camera_reference}
            : slam::AnchoredPose{slam::kNoId, content.tracked.T_camera_world};
    out_.poses.push_back(std::move(pose));
  }

  void take(const std::shared_ptr<map_update_t>& part) {
    if (!usable(part->status)) return;
    if (part->part_count == 1) return apply(*part);
    const auto seq = part->header.seq;
    auto& parts = parts_[seq];
    if (part->part_count < 1 || part->part_count > stage::kMaxParts || part->part_index < 0 ||
        part->part_index >= part->part_count)
      throw Error("MAP_UPDATE: part " + std::to_string(part->part_index) + " of " +
                  std::to_string(part->part_count) + " cannot be");
    parts.resize(static_cast<std::size_t>(part->part_count));
    parts[static_cast<std::size_t>(part->part_index)] = part;
    if (std::any_of(parts.begin(), parts.end(), [](const auto& each) { return !each; })) return;
    static const auto type = stage::message_type<map_update_t>();
    const auto whole = type.join({parts.begin(), parts.end()});
    parts_.erase(seq);
    apply(*std::static_pointer_cast<map_update_t>(whole));
  }

 private:
  void apply(const map_update_t& message) {
    const bool fresh = message.map_id != out_.map_id;
    if (message.to_version == 0) return;
    if (!fresh && message.to_version <= out_.map.version) return;
    if (message.from_version != 0 && (fresh || message.from_version > out_.map.version)) {
      throw Error("MAP_UPDATE of frame " + std::to_string(message.header.seq) +
                  " goes on from version " + std::to_string(message.from_version) +
                  ", which the log does not hold; take the log from the map's beginning on");
    }
    const auto update = slam::continued_from(messages::from_message(message), out_.map);
    if (fresh) {
      // Poses said before the mapper took their map up are in the map that begins now.
      for (auto& pose : out_.poses)
        if (pose.map_id == 0) pose.map_id = message.map_id;
      out_.map_ids.push_back(message.map_id);
      out_.map_id = message.map_id;
    } else {
      for (auto& pose : out_.poses)
        if (pose.map_id == out_.map_id) pose.anchor.follow(update, out_.map);
    }
    slam::apply(update, out_.map);
  }

  MapLog& out_;
  std::set<std::int64_t> seen_;  // frames whose pose has been read: a live log may hold repeats
  std::map<std::int64_t, std::vector<std::shared_ptr<map_update_t>>> parts_;
};

}  // namespace

dataset::Trajectory MapLog::path(bool corrected) const {
  dataset::Trajectory path;
  for (const auto& pose : poses) {
    if (pose.map_id != map_id || pose.tracked.state != slam::TrackingState::kTracked) continue;
    const auto T_world_camera =
        (corrected ? pose.anchor.T_camera_world(map) : pose.tracked.T_camera_world).inverse();
    path.push_back({pose.tracked.utime, T_world_camera.rotation, T_world_camera.translation});
  }
  std::stable_sort(path.begin(), path.end(),
                   [](const auto& a, const auto& b) { return a.utime < b.utime; });
  return path;
}

MapLog read_map_log(const std::string& path, const std::string& suffix) {
  stage::LogReader log(path);
  MapLog out;
  Reader reader(out);
  std::set<std::int64_t> sources;
  bool any = false;
  std::string camera;
  stage::LogEvent event;
  while (log.next(event)) {
    const bool pose = event.channel == "CAMERA_POSE" + suffix;
    const bool update = event.channel == "MAP_UPDATE" + suffix;
    if (event.channel == "MAP_OBJECTS" + suffix) {
      const auto message = decode<map_objects_t>(event);
      if (usable(message->status)) out.garments = messages::from_message(*message).garments;
    }
    if (event.channel == "RGBD_FRAME") {
      sources.insert(decode<rgbd_frame_t>(event)->header.seq);
    } else if (pose || update) {
      any = true;
      const auto message = pose ? nullptr : decode<map_update_t>(event);
      const auto said = pose ? decode<camera_pose_t>(event) : nullptr;
      const std::string& of = pose ? said->header.camera : message->header.camera;
      if (camera.empty()) camera = of;
      if (of != camera)
        throw Error(path + ": holds the poses of cameras " + camera + " and " + of +
                    "; weft log filter --camera takes one out");
      if (pose)
        reader.take(*said);
      else
        reader.take(message);
    }
  }
  if (!any)
    throw Error(path + ": holds neither CAMERA_POSE" + suffix + " nor MAP_UPDATE" + suffix +
                "; replay it through config/sets/map.yaml");
  out.frames = static_cast<std::int64_t>(sources.empty() ? out.poses.size() : sources.size());
  return out;
}

}  // namespace weft::mapping
