#include "slam/camera_path.hpp"

namespace weft::slam {

void CameraPath::add(const TrackedFrame& frame, const Map& map) {
  if (frame.state != TrackingState::kTracked) return;
  live_.push_back({frame.frame, frame.utime, frame.T_camera_world});
  anchors_.push_back(AnchoredPose::at(frame.T_camera_world, map, frame.reference));
}

void CameraPath::follow(const MapUpdate& update, const Map& before) {
  for (auto& anchor : anchors_) anchor.follow(update, before);
}

std::vector<CameraPath::Pose> CameraPath::poses(const Map& map) const {
  std::vector<Pose> out = live_;
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i].T_camera_world = anchors_[i].T_camera_world(map);
  return out;
}

}  // namespace weft::slam
