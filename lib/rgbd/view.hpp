#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "base/options.hpp"
#include "rgbd/frame.hpp"

/// The rectified view: the image warped to a virtual orthographic camera that looks along
/// the table's normal at a fixed scale, so that distance and tilt of the real camera do not matter
/// to anything computed in it. Its x axis is the camera's x axis projected to the table: the view
/// is never turned within its plane.
namespace weft::rgbd {

struct View {
  enum class Kind { kSensor, kRectified };
  Kind kind = Kind::kSensor;
  int width = 0;  // px, of the view
  int height = 0;
  CameraModel sensor;
  /// Homography from view px to sensor px for points on the table plane; identity for the sensor
  /// view. Cloth a few centimetres above the table is off by its parallax, height / distance of the
  /// offset from the nadir.
  Eigen::Matrix3d sensor_from_view = Eigen::Matrix3d::Identity();
  double scale_px_per_m = 0.0;  // of the rectified view, at the table; 0 for the sensor view
  Plane table;                  // camera frame; undefined for the sensor view

  Eigen::Vector2d to_sensor(const Eigen::Vector2d& view_px) const;
  Eigen::Vector2d to_view(const Eigen::Vector2d& sensor_px) const;
};

struct ViewOptions {
  bool rectified = true;
  double scale_px_per_m = 600.0;
  double margin_m = 0.04;
  int max_size_px = 1024;

  void visit(OptionVisitor& v) {
    v.field("rectified", rectified,
            "warp to the table plane before describing; false: the sensor image as it is (paper)");
    v.field("scale_px_per_m", scale_px_per_m, {50.0, 4000.0}, "px/m",
            "scale of the rectified view at the table");
    v.field("margin_m", margin_m, {0.0, 1.0}, "m",
            "table shown around the garment, so that windows may overhang it");
    v.field("max_size_px", max_size_px, {64, 8192}, "px",
            "longest side; a larger garment is cut off there");
  }
  void validate() const { validate_fields(*this, "ViewOptions"); }
};

/// Images of a frame in a view.
struct ViewImages {
  cv::Mat colour;  // CV_8UC3, BGR; empty when the frame has none
  cv::Mat mask;    // CV_8UC1, 255 = garment; 0 also outside the sensor image
};

/// The view of a frame: the sensor image itself, or the rectified view that just holds the garment
/// mask. mask: CV_8UC1 of the frame's size. Throws Error when rectification is asked for without a
/// usable table plane (5 cm to 20 m away, tilted by at most 75 degrees) or when the mask is empty.
View make_view(const RgbdFrame& frame, const cv::Mat& mask, const Plane* table,
               const ViewOptions& options);

/// Warps colour (bilinear in fixed point; averaged over 2x2 pixels first where the sensor is at
/// least twice as fine as the view) and mask (nearest). Outside the sensor image its border is
/// repeated in colour, so that no edge appears there. Depth: rgbd/surface.hpp. Class A: the same
/// bits everywhere. Throws Error when the images do not fit the view's sensor.
ViewImages render_view(const RgbdFrame& frame, const cv::Mat& mask, const View& view);

}  // namespace weft::rgbd
