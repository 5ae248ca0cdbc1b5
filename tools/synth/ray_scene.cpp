#include "synth/ray_scene.hpp"

#include <embree3/rtcore.h>

#include <cstring>

#include "base/error.hpp"

namespace weft::synth {

struct RayScene::Data {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~Data() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

RayScene::RayScene() : data_(std::make_unique<Data>()) {
  data_->device = rtcNewDevice("threads=1,isa=sse4.2");
  if (data_->device == nullptr) {
    throw Error("Embree: no device; a processor with SSE 4.2 is needed to render scenes");
  }
  data_->scene = rtcNewScene(data_->device);
  rtcSetSceneFlags(data_->scene, RTC_SCENE_FLAG_ROBUST);
}

RayScene::~RayScene() = default;

void RayScene::add(const Surface& s) {
  RTCGeometry geometry = rtcNewGeometry(data_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                               RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                                               s.position.size()));
  auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), s.faces.size()));
  if (vertices == nullptr || indices == nullptr) {
    rtcReleaseGeometry(geometry);
    throw Error("Embree: no memory for a surface of " + std::to_string(s.faces.size()) + " faces");
  }
  for (std::size_t i = 0; i < s.position.size(); ++i) {
    for (int c = 0; c < 3; ++c) vertices[3 * i + static_cast<std::size_t>(c)] = s.position[i][c];
  }
  for (std::size_t i = 0; i < s.faces.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) indices[3 * i + c] = static_cast<unsigned>(s.faces[i][c]);
  }
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(data_->scene, geometry);
  rtcReleaseGeometry(geometry);
}

void RayScene::commit() { rtcCommitScene(data_->scene); }

RayHit RayScene::intersect(const Vec3& origin, const Vec3& direction, float near, float far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit r{};
  r.ray.org_x = origin.x();
  r.ray.org_y = origin.y();
  r.ray.org_z = origin.z();
  r.ray.dir_x = direction.x();
  r.ray.dir_y = direction.y();
  r.ray.dir_z = direction.z();
  r.ray.tnear = near;
  r.ray.tfar = far;
  r.ray.mask = ~0u;
  r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(data_->scene, &context, &r);
  RayHit hit;
  if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;
  hit.object = static_cast<int>(r.hit.geomID);
  hit.face = static_cast<int>(r.hit.primID);
  hit.distance = r.ray.tfar;
  hit.u = r.hit.u;
  hit.v = r.hit.v;
  hit.geometric_normal = Vec3(r.hit.Ng_x, r.hit.Ng_y, r.hit.Ng_z);
  return hit;
}

bool RayScene::occluded(const Vec3& origin, const Vec3& direction, float near, float far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray{};
  ray.org_x = origin.x();
  ray.org_y = origin.y();
  ray.org_z = origin.z();
  ray.dir_x = direction.x();
  ray.dir_y = direction.y();
  ray.dir_z = direction.z();
  ray.tnear = near;
  ray.tfar = far;
  ray.mask = ~0u;
  rtcOccluded1(data_->scene, &context, &ray);
  return ray.tfar < 0.0f;
}

}  // namespace weft::synth
