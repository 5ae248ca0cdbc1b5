#pragma once

#include <string>

#include "dataset/trajectory_file.hpp"
#include "slam/garment_map.hpp"
#include "slam/map.hpp"

/// A map in the formats of other programs. World frame, metres.
namespace weft::mapping {

/// What is written: the map, and the camera's path and the garments, which may be empty.
struct MapContent {
  slam::Map map;
  dataset::Trajectory path;
  std::vector<slam::Garment> garments;
};

/// Vertices with colour: map points grey, the planes' clouds in a colour a plane, the path red.
/// Binary, little endian (PLY).
std::string to_ply(const MapContent& content);
/// The same points as an ASCII PCD with fields x y z rgb label (label: 0 point, 1 path, 2 + id of
/// the plane).
std::string to_pcd(const MapContent& content);
/// Planes as the convex outlines of their clouds (faces), the path as a line, points as points, a
/// garment as its middle and its parts, named.
std::string to_obj(const MapContent& content);
/// Everything: key frames with their poses, points, planes with covariance and outline, the path,
/// garments and their parts.
std::string to_json(const MapContent& content);

/// A corner list, in order, around a plane's cloud: its convex hull within the plane. Empty for
/// fewer than three points.
std::vector<Eigen::Vector3d> outline(const slam::MapPlane& plane);

}  // namespace weft::mapping
