#pragma once

#include "rgbd/view.hpp"
#include "weft/camera_model_t.hpp"
#include "weft/plane_t.hpp"
#include "weft/view_t.hpp"

/// Camera, plane and view to and from their messages. from_message throws stage::InvalidInput,
/// naming `where` and the field, for content no sender of ours makes.
namespace weft::messages {

camera_model_t to_message(const rgbd::CameraModel& camera);
rgbd::CameraModel from_message(const camera_model_t& message, const std::string& where);

plane_t to_message(const rgbd::Plane& plane);
/// The normal must be of unit length within 1e-6 and everything finite.
rgbd::Plane from_message(const plane_t& message, const std::string& where);

view_t to_message(const rgbd::View& view);
/// A view's size must be 1 to 8192 px a side, its homography finite and invertible; a sensor view
/// must have the sensor's size.
rgbd::View from_message(const view_t& message, const std::string& where);

}  // namespace weft::messages
