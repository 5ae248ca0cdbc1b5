#pragma once

#include "synth/room.hpp"
#include "synth/view_scene.hpp"

namespace weft::synth {

/// What lies on a desk in a room, and its light. It does not change while a camera moves.
struct RoomContent {
  Room room;
  Lighting lighting;
  std::vector<const Garment*> garments;  // must outlive the scene
  std::vector<Placement> placements;     // by garment
  std::vector<Fabric> fabrics;           // by garment
};

struct RoomView {
  rgbd::CameraModel camera;
  CameraPose pose;
  float baseline_m = 0.075f, projector_sign = -1.0f;  // of the depth sensor's projector
  int samples = 2;                                    // colour samples a pixel along each axis
};

struct RoomImages {
  IdealImages ideal;  // objects are garments only; parts and inside stay empty
  cv::Mat instances;  // CV_8UC1: 0 nothing, 1 + index of the garment, 255 desk
};

constexpr std::uint8_t kDeskInstance = 255;

/// Light is summed once, at the vertices of everything; views then cost rays and textures only.
class RoomScene {
 public:
  explicit RoomScene(RoomContent content);

  RoomImages render(const RoomView& view) const;

  /// What an eye that looks everywhere sees of a garment's part instances, in their order.
  struct PartSeen {
    double area_m2 = 0.0, seen_m2 = 0.0;
    Vec3 centre = Vec3::Zero();  // of what is seen; world
  };
  std::vector<PartSeen> parts_seen_from(const Vec3& eye, std::size_t garment) const;
  const RoomContent& content() const { return content_; }

 private:
  Vec3 shade(const RayHit& hit, const Vec3& direction) const;

  RoomContent content_;
  std::vector<Surface> surfaces_;               // garments, fine, then the room's solids
  std::vector<std::vector<Irradiance>> light_;  // by surface and vertex
  RayScene scene_;
};

/// A camera at `origin` that looks at `target`, its picture upright; up: of the world, or where it
/// looks straight down the direction that is up in the picture.
CameraPose look_at(const Vec3& origin, const Vec3& target, const Vec3& up);

}  // namespace weft::synth
