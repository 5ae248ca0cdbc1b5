#include "messages/view.hpp"

#include <Eigen/LU>
#include <cmath>

#include "stage/stage.hpp"

namespace weft::messages {

camera_model_t to_message(const rgbd::CameraModel& camera) {
  camera_model_t message;
  message.width = camera.width;
  message.height = camera.height;
  message.fx = camera.fx;
  message.fy = camera.fy;
  message.cx = camera.cx;
  message.cy = camera.cy;
  return message;
}

rgbd::CameraModel from_message(const camera_model_t& message, const std::string& where) {
  const rgbd::CameraModel camera{message.width, message.height, message.fx,
                                 message.fy,    message.cx,     message.cy};
  try {
    camera.validate(where);
  } catch (const Error& error) {
    throw stage::InvalidInput(error.what());
  }
  return camera;
}

plane_t to_message(const rgbd::Plane& plane) {
  plane_t message;
  for (int i = 0; i < 3; ++i) message.normal[i] = plane.normal[i];
  message.distance_m = plane.distance_m;
  message.rms_m = plane.rms_m;
  message.support = plane.support;
  return message;
}

rgbd::Plane from_message(const plane_t& message, const std::string& where) {
  rgbd::Plane plane;
  for (int i = 0; i < 3; ++i) plane.normal[i] = message.normal[i];
  plane.distance_m = message.distance_m;
  plane.rms_m = message.rms_m;
  plane.support = message.support;
  if (!plane.normal.allFinite() || std::abs(plane.normal.norm() - 1.0) > 1e-6)
    throw stage::InvalidInput(where + ": the plane's normal is not of unit length");
  if (!std::isfinite(plane.distance_m) || !(plane.rms_m >= 0.0) || !std::isfinite(plane.rms_m) ||
      plane.support < 0)
    throw stage::InvalidInput(where + ": the plane's distance, rms or support is impossible");
  return plane;
}

view_t to_message(const rgbd::View& view) {
  view_t message;
  message.kind = view.kind == rgbd::View::Kind::kRectified ? view_t::RECTIFIED : view_t::SENSOR;
  message.width = view.width;
  message.height = view.height;
  message.sensor = to_message(view.sensor);
  for (int i = 0; i < 9; ++i) message.sensor_from_view[i] = view.sensor_from_view(i / 3, i % 3);
  message.scale_px_per_m = view.scale_px_per_m;
  message.table = to_message(view.table);
  return message;
}

rgbd::View from_message(const view_t& message, const std::string& where) {
  rgbd::View view;
  if (message.kind != view_t::SENSOR && message.kind != view_t::RECTIFIED)
    throw stage::InvalidInput(where + ": unknown kind of view " + std::to_string(message.kind));
  view.width = message.width;
  view.height = message.height;
  if (view.width < 1 || view.width > 8192 || view.height < 1 || view.height > 8192)
    throw stage::InvalidInput(where + ": a view of " + std::to_string(view.width) + " x " +
                              std::to_string(view.height) + " px");
  view.sensor = from_message(message.sensor, where + ": sensor");
  if (message.kind == view_t::SENSOR) {
    if (view.width != view.sensor.width || view.height != view.sensor.height)
      throw stage::InvalidInput(where + ": a sensor view of another size than the sensor");
    return view;
  }
  view.kind = rgbd::View::Kind::kRectified;
  for (int i = 0; i < 9; ++i) view.sensor_from_view(i / 3, i % 3) = message.sensor_from_view[i];
  const Eigen::Matrix3d inverse = view.sensor_from_view.inverse();
  if (!view.sensor_from_view.allFinite() || !inverse.allFinite())
    throw stage::InvalidInput(where + ": the view's homography is not invertible");
  view.scale_px_per_m = message.scale_px_per_m;
  if (!(view.scale_px_per_m > 0.0) || !std::isfinite(view.scale_px_per_m))
    throw stage::InvalidInput(where + ": the view's scale is not positive");
  view.table = from_message(message.table, where + ": table");
  return view;
}

}  // namespace weft::messages
