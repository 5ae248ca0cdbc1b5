#pragma once

#include <opencv2/core/mat.hpp>

#include "mapping/map_export.hpp"

/// Pictures of a map for people.
namespace weft::mapping {

struct PictureOptions {
  int width_px = 1200;
  int height_px = 900;
};

/// Up in the world: the normal of the plane that the first garment lies on; else of the largest
/// plane within 60 degrees of the first camera's up (the floor, a table); else that itself.
Eigen::Vector3d up_direction(const MapContent& content);

/// The map from straight above: planes' voxels, points, the path with key frames, a grid of 1 m.
cv::Mat top_picture(const MapContent& content, const PictureOptions& options = {});

/// The map from obliquely above and behind the first camera.
cv::Mat oblique_picture(const MapContent& content, const PictureOptions& options = {});

}  // namespace weft::mapping
