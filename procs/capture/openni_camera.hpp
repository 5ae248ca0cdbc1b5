#pragma once

#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>

#include "base/options.hpp"
#include "rgbd/frame.hpp"

/// Cameras and .oni recordings through OpenNI2.
namespace weft::capture_process {

struct OpenNiOptions {
  int width_px = 640;
  int height_px = 480;
  int rate_hz = 30;
  bool require_registration = true;
  double timeout_s = 5.0;
  double fx_px = 0.0, fy_px = 0.0, cx_px = -1.0, cy_px = -1.0;

  void visit(OptionVisitor& v) {
    v.field("width_px", width_px, {1, 8192}, "px",
            "of colour and depth; a recording keeps its own size");
    v.field("height_px", height_px, {1, 8192}, "px",
            "of colour and depth; a recording keeps its own size");
    v.field("rate_hz", rate_hz, {1, 1000}, "Hz", "of the camera; a recording keeps its own");
    v.field("require_registration", require_registration,
            "refuse a camera that cannot register its depth to its colour; a recording does not "
            "say, and is taken to be registered");
    v.field("timeout_s", timeout_s, {0.1, 3600.0}, "s",
            "a camera that gives no pair of images for so long has failed");
    v.field("fx_px", fx_px, {0.0, 1e5}, "px",
            "focal length by calibration; 0: from the camera's field of view");
    v.field("fy_px", fy_px, {0.0, 1e5}, "px", "focal length by calibration; 0: as fx_px");
    v.field("cx_px", cx_px, {-1.0, 8192.0}, "px", "principal point; -1: the image centre");
    v.field("cy_px", cy_px, {-1.0, 8192.0}, "px", "principal point; -1: the image centre");
  }
  void validate() const { validate_fields(*this, "OpenNiOptions"); }
};

/// An open camera or recording. Recordings are read frame by frame, as fast as they are asked for,
/// and end after their last.
class OpenNiCamera {
 public:
  /// device: "any", a URI, or the path of an .oni file. Throws Error; when no camera is found it
  /// says where drivers were looked for, which USB devices and permissions there are.
  OpenNiCamera(const std::string& device, const OpenNiOptions& options);
  ~OpenNiCamera();
  OpenNiCamera(const OpenNiCamera&) = delete;
  OpenNiCamera& operator=(const OpenNiCamera&) = delete;

  /// Colour and depth taken at the same time. device_time_us: the camera's own clock. False at the
  /// end of a recording, or when stop was requested. Throws Error when the camera falls silent.
  bool next(rgbd::RgbdFrame& frame, std::int64_t& device_time_us, const std::stop_token& stop);
  bool is_recording() const;
  /// Frames of a recording; 0 for a camera.
  int frame_count() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace weft::capture_process
