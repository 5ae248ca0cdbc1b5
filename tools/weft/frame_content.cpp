#include "tools/weft/frame_content.hpp"

#include <algorithm>
#include <cmath>

#include "tools/weft/message.hpp"

namespace weft {
namespace {

const char* status_name(std::int8_t code) {
  switch (code) {
    case weft::status_t::OK:
      return "OK";
    case weft::status_t::NOTHING:
      return "NOTHING";
    case weft::status_t::FAILED:
      return "FAILED";
    case weft::status_t::DROPPED:
      return "DROPPED";
    case weft::status_t::MISSING_INPUT:
      return "MISSING_INPUT";
    default:
      return "of an unknown status";
  }
}

template <class Message>
bool take(const std::vector<std::uint8_t>& data, std::optional<Message>& into) {
  if (into) return false;
  into = decode_message<Message>(data);
  return into.has_value();
}

bool finite(const double* values, int count) {
  return std::all_of(values, values + count,
                     [](double v) { return std::isfinite(v) && std::abs(v) < 1e6; });
}

std::string contradiction(const weft::rgbd_frame_t& frame) {
  const auto& camera = frame.camera_model;
  const std::int64_t total = std::int64_t{frame.colour_size} + frame.depth_size + frame.mask_size;
  if (camera.width < 1 || camera.height < 1 || camera.width > 8192 || camera.height > 8192)
    return "image size";
  if (frame.colour_size < 0 || frame.depth_size < 0 || frame.mask_size < 0 ||
      total != static_cast<std::int64_t>(frame.data.size()))
    return "sizes of the encoded planes";
  const double numbers[] = {camera.fx, camera.fy, camera.cx, camera.cy};
  return finite(numbers, 4) ? "" : "intrinsics";
}

std::string contradiction(const weft::foreground_t& foreground) {
  std::int64_t sum = 0;
  for (const auto run : foreground.runs) {
    if (run < 0) return "run lengths";
    sum += run;
  }
  return foreground.width > 0 && foreground.height > 0 && foreground.width <= 8192 &&
                 foreground.height <= 8192 &&
                 sum == std::int64_t{foreground.width} * foreground.height
             ? ""
             : "run lengths";
}

std::string contradiction(const weft::probability_map_t& maps) {
  if (maps.columns < 1 || maps.rows < 1 || maps.columns > 8192 || maps.rows > 8192)
    return "grid size";
  const double numbers[] = {maps.origin_x, maps.origin_y, maps.step_px};
  if (!finite(numbers, 3) || maps.step_px <= 0 || !finite(maps.view.sensor_from_view, 9))
    return "grid geometry";
  for (const auto& map : maps.maps) {
    if (static_cast<std::int64_t>(map.values.size()) != std::int64_t{maps.columns} * maps.rows)
      return "map size";
    if (!(map.full_scale >= 0.0) || map.full_scale > 1e6) return "scale of a map";
  }
  return "";
}

std::string contradiction(const weft::part_detections_t& detections) {
  for (const auto& each : detections.detections) {
    if (!std::isfinite(each.probability) || !finite(&each.corners_sensor[0][0], 8) ||
        !finite(each.centre_sensor, 2))
      return "detection of " + each.part;
  }
  return "";
}

std::string contradiction(const weft::grasps_t& grasps) {
  for (const auto& each : grasps.grasps) {
    if (!std::isfinite(each.score) || !finite(each.pixel, 2) || !finite(each.point_camera_m, 3) ||
        !finite(each.approach_camera, 3))
      return "grasp of " + each.part;
  }
  return "";
}

std::string contradiction(const weft::planes_t& planes) {
  for (const auto& each : planes.planes) {
    if (!finite(each.plane.normal, 3) || !finite(&each.plane.distance_m, 1) ||
        each.points_camera_m.size() % 3 != 0)
      return "plane";
  }
  for (const auto& each : planes.cylinders) {
    if (!finite(each.point_camera_m, 3) || !finite(each.axis_camera, 3) ||
        !finite(&each.radius_m, 1) || each.points_camera_m.size() % 3 != 0)
      return "cylinder";
  }
  return "";
}

std::string contradiction(const weft::camera_pose_t& pose) {
  if (pose.state < weft::camera_pose_t::NOT_STARTED || pose.state > weft::camera_pose_t::LOST)
    return "state";
  return finite(pose.T_world_camera.translation, 3) && finite(pose.T_world_camera.rotation, 4)
             ? ""
             : "pose";
}

template <class Message>
void check(std::optional<Message>& message, const char* what, FrameContent& content) {
  if (!message) return;
  // Of a frame that failed, the fields other than header and status are not set.
  const auto code = message->status.code;
  if (code != weft::status_t::OK && code != weft::status_t::NOTHING) {
    message.reset();
    return;
  }
  const auto text = contradiction(*message);
  if (text.empty()) return;
  if (code == weft::status_t::OK) {
    content.problems.push_back(std::string(what) + ": impossible " + text);
    content.failed = true;
  }
  message.reset();  // an answer of nothing may have content, but need not
}

}  // namespace

FrameContent read_content(const PlayedFrame& frame) {
  FrameContent content;
  const auto note = [&](const std::string& channel, const std::vector<std::uint8_t>& data) {
    const auto header = read_frame_header(data);
    if (!header || header->status_code == weft::status_t::OK ||
        header->status_code == weft::status_t::NOTHING)
      return;
    content.failed = true;
    content.problems.push_back(channel + " " + status_name(header->status_code) + ": " +
                               header->text);
  };
  std::vector<weft::rgbd_frame_t> parts;
  for (const auto& event : frame.source.events) {
    note(event.channel, event.data);
    std::optional<weft::rgbd_frame_t> part;
    if (take(event.data, part)) parts.push_back(std::move(*part));
  }
  std::sort(parts.begin(), parts.end(),
            [](const auto& a, const auto& b) { return a.part_index < b.part_index; });
  if (!parts.empty()) {
    content.rgbd = parts.front();
    for (std::size_t i = 1; i < parts.size(); ++i)
      content.rgbd->data.insert(content.rgbd->data.end(), parts[i].data.begin(),
                                parts[i].data.end());
  }
  for (const auto& output : frame.outputs) {
    note(output.channel, output.data);
    take(output.data, content.foreground) || take(output.data, content.maps) ||
        take(output.data, content.detections) || take(output.data, content.grasps) ||
        take(output.data, content.planes) || take(output.data, content.pose);
  }
  for (const auto& channel : frame.unanswered) content.problems.push_back(channel + " unanswered");
  check(content.rgbd, "RGBD_FRAME", content);
  check(content.foreground, "FOREGROUND", content);
  check(content.maps, "PROBABILITY_MAP", content);
  check(content.detections, "PART_DETECTIONS", content);
  check(content.grasps, "GRASPS", content);
  check(content.planes, "PLANES", content);
  check(content.pose, "CAMERA_POSE", content);
  return content;
}

}  // namespace weft
