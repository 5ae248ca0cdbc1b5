#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "fuzz/fuzz.hpp"
#include "messages/map.hpp"
#include "messages/map_objects.hpp"
#include "messages/planes.hpp"

/// The messages of planes, camera and map.
namespace weft::fuzz {
namespace {

template <class Message, class Check>
Target target(Message message, const Check& check) {
  message.header.camera = "camera";
  message.header.coordinate_frame = "world";
  message.header.seq = 2;
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return {{bytes}, [check](const Bytes& input) {
            Message decoded{};
            const int size = static_cast<int>(input.size());
            if (decoded.decode(input.data(), 0, size) != size) throw Error("no such message");
            check(decoded);
          }};
}

constexpr auto kFromMessage = [](const auto& message) { messages::from_message(message); };

plane::PlaneSegment segment() {
  plane::PlaneSegment out;
  out.plane.distance_m = -1.5;
  out.plane.support = 300;
  out.covariance = Eigen::Vector3d(1e-4, 1e-4, 1e-6).asDiagonal();
  out.cells = 2;
  out.points_camera = {{0.1f, 0.2f, 1.5f}, {0.3f, 0.2f, 1.5f}};
  return out;
}

std::vector<slam::Feature> features() {
  std::vector<slam::Feature> out(3);
  for (auto& f : out) f = {10.0f, 20.0f, 1.5f, 90.0f, 2, {1, 2, 3, 4}};
  return out;
}

WEFT_FUZZ_TARGET(Planes) {
  plane::Extraction extraction;
  extraction.planes = {segment(), segment()};
  plane::CylinderSegment cylinder;
  cylinder.point_camera = {0.1, 0.2, 1.5};
  cylinder.radius_m = 0.1;
  cylinder.points_camera = {{0.1f, 0.2f, 1.4f}};
  extraction.cylinders = {cylinder};
  extraction.labels = cv::Mat(30, 40, CV_8UC1, cv::Scalar(1));
  extraction.labels(cv::Rect(3, 4, 10, 12)) = 3;
  planes_t message{};
  messages::to_message(extraction, {40, 30, 50.0, 50.0, 20.0, 15.0}, true, message);
  return target(message, kFromMessage);
}

WEFT_FUZZ_TARGET(CameraPose) {
  slam::TrackedFrame tracked;
  tracked.state = slam::TrackingState::kTracked;
  tracked.reason = "found again";
  tracked.covariance = Eigen::Matrix<double, 6, 6>::Identity();
  camera_pose_t message{};
  messages::to_message(tracked, 0, 5, message);
  return target(message, kFromMessage);
}

WEFT_FUZZ_TARGET(KeyFrame) {
  slam::NewKeyFrame key_frame;
  key_frame.input.camera = {40, 30, 50.0, 50.0, 20.0, 15.0};
  key_frame.input.features = features();
  key_frame.points = {1, slam::kNoId, 7};
  key_frame.input.planes = {segment()};
  key_frame.planes = {3};
  key_frame.seen_points = {{1, 2, 1}};
  key_frame.seen_planes = {{3, 2, 2}};
  keyframe_t message{};
  messages::to_message(&key_frame, 0, {5, 1}, message);
  return target(message, kFromMessage);
}

WEFT_FUZZ_TARGET(MapUpdate) {
  slam::Map map;
  map.version = 3;
  slam::KeyFrame& k = map.key_frames[0];
  k.id = 0;
  k.camera = {40, 30, 50.0, 50.0, 20.0, 15.0};
  k.features = features();
  k.points = {0, slam::kNoId, slam::kNoId};
  k.planes = {{segment(), 0}};
  slam::MapPoint& p = map.points[0];
  p.id = 0;
  p.max_distance_m = 3.0;
  p.observations = {{0, 0}};
  p.first_key_frame = 0;
  slam::MapPlane& plane = map.planes[0];
  plane.id = 0;
  plane.cloud_world = {{1, 2, 3}};
  plane.observations = {{0, 0}};
  map_update_t message{};
  messages::to_message(slam::whole_map(map, 2), 5, map, message);
  return target(message, [](const map_update_t& m) {
    slam::Map copy;
    slam::apply(messages::from_message(m), copy);  // what is no map must be refused as well
  });
}

WEFT_FUZZ_TARGET(MapObjects) {
  slam::GarmentPart part;
  part.part = "polo collar";
  part.has_grasp = true;
  slam::Garment garment;
  garment.id = 3;
  garment.parts = {part, part};
  messages::MapObjectsContent content{5, 2, slam::Rigid3d{}, {garment}};
  map_objects_t message{};
  messages::to_message(content, message);
  return target(message, kFromMessage);
}

}  // namespace
}  // namespace weft::fuzz
