#pragma once

#include <memory>

#include "synth/surface.hpp"

namespace weft::synth {

struct RayHit {
  int object = -1;  // -1: nothing
  int face = 0;
  float distance = 0.0f;     // in lengths of the direction
  float u = 0.0f, v = 0.0f;  // barycentric weights of the face's second and third vertex
  Vec3 geometric_normal = Vec3::Zero();  // not normalised, towards the outside
};

/// Ray casting on surfaces (Embree, one thread, a fixed instruction set so that every machine finds
/// the same hits). Surfaces are copied.
class RayScene {
 public:
  RayScene();
  ~RayScene();
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;

  /// Objects are numbered in the order they are added.
  void add(const Surface& surface);
  void commit();

  RayHit intersect(const Vec3& origin, const Vec3& direction, float near = 0.0f,
                   float far = 1e30f) const;
  bool occluded(const Vec3& origin, const Vec3& direction, float near, float far) const;

 private:
  struct Data;
  std::unique_ptr<Data> data_;
};

}  // namespace weft::synth
