#include "messages/planes.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "messages/view.hpp"
#include "rgbd/codec.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

constexpr std::size_t kMaxSegments = 255;

Eigen::Vector3d vector(const double (&values)[3]) {
  return Eigen::Map<const Eigen::Vector3d>(values);
}

void copy(const Eigen::Vector3d& from, double (&to)[3]) { std::copy_n(from.data(), 3, to); }

cylinder_segment_t to_message(const plane::CylinderSegment& segment) {
  cylinder_segment_t message{};
  copy(segment.point_camera, message.point_camera_m);
  copy(segment.axis, message.axis_camera);
  message.radius_m = segment.radius_m;
  message.convex = segment.convex ? 1 : 0;
  message.rms_m = segment.rms_m;
  message.support = segment.support;
  message.cells = segment.cells;
  message.points_camera_m = to_coordinates(segment.points_camera);
  message.coordinate_count = static_cast<std::int32_t>(message.points_camera_m.size());
  return message;
}

plane::CylinderSegment from_message(const cylinder_segment_t& message, const std::string& where) {
  plane::CylinderSegment segment;
  segment.point_camera = vector(message.point_camera_m);
  segment.axis = vector(message.axis_camera);
  segment.radius_m = message.radius_m;
  segment.convex = message.convex != 0;
  segment.rms_m = message.rms_m;
  segment.support = message.support;
  segment.cells = message.cells;
  if (!segment.point_camera.allFinite() || !(std::abs(segment.axis.norm() - 1.0) <= 1e-6) ||
      !(segment.radius_m > 0.0) || !std::isfinite(segment.radius_m) || !(segment.rms_m >= 0.0) ||
      !std::isfinite(segment.rms_m) || segment.support < 0 || segment.cells < 0)
    throw stage::InvalidInput(where + ": the axis, radius or counts are impossible");
  segment.points_camera = from_coordinates(message.points_camera_m, where);
  return segment;
}

}  // namespace

void to_triangle(const Eigen::Matrix3d& covariance, double (&triangle)[6]) {
  int at = 0;
  for (int row = 0; row < 3; ++row)
    for (int column = row; column < 3; ++column) triangle[at++] = covariance(row, column);
}

Eigen::Matrix3d from_triangle(const double (&triangle)[6], const std::string& where) {
  Eigen::Matrix3d covariance;
  int at = 0;
  for (int row = 0; row < 3; ++row)
    for (int column = row; column < 3; ++column)
      covariance(row, column) = covariance(column, row) = triangle[at++];
  if (!covariance.allFinite() || !(covariance.diagonal().array() >= 0.0).all())
    throw stage::InvalidInput(where + ": the covariance is not finite or has a negative variance");
  return covariance;
}

std::vector<float> to_coordinates(const std::vector<Eigen::Vector3f>& points) {
  std::vector<float> coordinates;
  coordinates.reserve(3 * points.size());
  for (const auto& point : points)
    coordinates.insert(coordinates.end(), point.data(), point.data() + 3);
  return coordinates;
}

std::vector<Eigen::Vector3f> from_coordinates(const std::vector<float>& coordinates,
                                              const std::string& where) {
  if (coordinates.size() % 3 != 0)
    throw stage::InvalidInput(where + ": " + std::to_string(coordinates.size()) +
                              " coordinates are not three a point");
  if (!std::all_of(coordinates.begin(), coordinates.end(),
                   [](float c) { return std::isfinite(c); }))
    throw stage::InvalidInput(where + ": a point is not finite");
  std::vector<Eigen::Vector3f> points;
  points.reserve(coordinates.size() / 3);
  for (std::size_t i = 0; i < coordinates.size(); i += 3)
    points.emplace_back(coordinates[i], coordinates[i + 1], coordinates[i + 2]);
  return points;
}

plane_segment_t to_message(const plane::PlaneSegment& segment) {
  plane_segment_t message{};
  message.plane = to_message(segment.plane);
  to_triangle(segment.covariance, message.covariance);
  message.cells = segment.cells;
  message.points_camera_m = to_coordinates(segment.points_camera);
  message.coordinate_count = static_cast<std::int32_t>(message.points_camera_m.size());
  return message;
}

plane::PlaneSegment from_message(const plane_segment_t& message, const std::string& where) {
  plane::PlaneSegment segment;
  segment.plane = from_message(message.plane, where);
  segment.covariance = from_triangle(message.covariance, where);
  if (message.cells < 0) throw stage::InvalidInput(where + ": a negative number of cells");
  segment.cells = message.cells;
  segment.points_camera = from_coordinates(message.points_camera_m, where);
  return segment;
}

void to_message(const plane::Extraction& extraction, const rgbd::CameraModel& camera, bool labels,
                planes_t& message) {
  message.camera_model = to_message(camera);
  message.planes.clear();
  for (const auto& segment : extraction.planes) message.planes.push_back(to_message(segment));
  message.plane_count = static_cast<std::int32_t>(message.planes.size());
  message.cylinders.clear();
  for (const auto& segment : extraction.cylinders) message.cylinders.push_back(to_message(segment));
  message.cylinder_count = static_cast<std::int32_t>(message.cylinders.size());
  message.label_encoding = labels ? planes_t::LABELS_PNG : planes_t::LABELS_NONE;
  message.labels.clear();
  if (labels) message.labels = rgbd::encode_png(extraction.labels, rgbd::PngKind::kLabels);
  message.label_size = static_cast<std::int32_t>(message.labels.size());
}

PlanesContent from_message(const planes_t& message, bool with_labels) {
  const std::string where = "PLANES";
  PlanesContent content;
  content.camera = from_message(message.camera_model, where);
  const std::size_t segments = message.planes.size() + message.cylinders.size();
  if (segments > kMaxSegments)
    throw stage::InvalidInput(where + ": " + std::to_string(segments) + " segments, more than " +
                              std::to_string(kMaxSegments));
  for (const auto& segment : message.planes)
    content.extraction.planes.push_back(from_message(
        segment, where + ": plane " + std::to_string(content.extraction.planes.size())));
  for (const auto& segment : message.cylinders)
    content.extraction.cylinders.push_back(from_message(
        segment, where + ": cylinder " + std::to_string(content.extraction.cylinders.size())));
  if (message.label_encoding != planes_t::LABELS_NONE &&
      message.label_encoding != planes_t::LABELS_PNG)
    throw stage::InvalidInput(where + ": unknown label encoding " +
                              std::to_string(message.label_encoding));
  if ((message.label_encoding == planes_t::LABELS_NONE) != message.labels.empty())
    throw stage::InvalidInput(where + ": labels of encoding " +
                              std::to_string(message.label_encoding) + " have " +
                              std::to_string(message.labels.size()) + " bytes");
  if (!with_labels || message.labels.empty()) return content;
  try {
    content.extraction.labels =
        rgbd::decode_png(message.labels.data(), message.labels.size(), rgbd::PngKind::kLabels,
                         content.camera.width, content.camera.height, where + ": labels");
  } catch (const Error& e) {
    throw stage::InvalidInput(e.what());
  }
  double largest = 0.0;
  cv::minMaxLoc(content.extraction.labels, nullptr, &largest);
  if (largest > static_cast<double>(segments))
    throw stage::InvalidInput(where + ": label " + std::to_string(static_cast<int>(largest)) +
                              " of " + std::to_string(segments) + " segments");
  return content;
}

}  // namespace weft::messages
