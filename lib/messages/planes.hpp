#pragma once

#include <string>

#include "plane/extractor.hpp"
#include "weft/plane_segment_t.hpp"
#include "weft/planes_t.hpp"

/// PLANES to and from what lib/plane extracts.
namespace weft::messages {

plane_segment_t to_message(const plane::PlaneSegment& segment);
/// Throws stage::InvalidInput naming `where`: a normal that is not of unit length, a covariance
/// that is not finite or has a negative variance, coordinates that are not three a point.
plane::PlaneSegment from_message(const plane_segment_t& message, const std::string& where);

/// Fills in everything but header and status. labels: with the label image, a PNG.
void to_message(const plane::Extraction& extraction, const rgbd::CameraModel& camera, bool labels,
                planes_t& message);

struct PlanesContent {
  rgbd::CameraModel camera;
  plane::Extraction extraction;  // its labels are empty when the message has none
};

/// Throws stage::InvalidInput for content no sender of ours makes: see above, counts that do not
/// agree, more than 255 segments, labels beyond them or not of the camera's size. with_labels:
/// decode the label image.
PlanesContent from_message(const planes_t& message, bool with_labels = true);

/// Upper triangle of a symmetric matrix, row by row, and back.
void to_triangle(const Eigen::Matrix3d& covariance, double (&triangle)[6]);
Eigen::Matrix3d from_triangle(const double (&triangle)[6], const std::string& where);

/// x, y, z after each other.
std::vector<float> to_coordinates(const std::vector<Eigen::Vector3f>& points);
std::vector<Eigen::Vector3f> from_coordinates(const std::vector<float>& coordinates,
                                              const std::string& where);

}  // namespace weft::messages
