#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "dataset/scene.hpp"

/// The readers behind open_dataset and what they share.
namespace weft::dataset {

/// Images from PNG or JPEG files. The size is read and checked before the image is decoded. Throw
/// Error naming the file and the reason.
cv::Mat read_colour_image(const std::string& path);  // CV_8UC3, BGR
cv::Mat read_depth_image(const std::string& path);   // CV_16UC1; 65535, "too far", becomes 0

/// Part polygons drawn by hand, for scans whose set has none: parts.json.
///   {"scenes": {NAME: {PART: [[[x, y], ...], ...], ..., "ignore": {PART: REASON, ...}}}}
/// Pixels of the colour image as it is in its file.
struct PartsFile {
  struct SceneParts {
    std::vector<PartPolygon> polygons;
    std::vector<std::string> ignored;
  };
  std::map<std::string, SceneParts> scenes;
};
/// Throws Error naming the file and the place. No file: no scenes.
PartsFile read_parts_file(const std::string& path);
/// Adds the file's polygons to a scene, each point moved from the colour file's px to the frame's.
/// A part that is to be ignored in the whole scene gets the garment's outline, or the whole image,
/// as an ignored polygon.
void add_parts(const PartsFile& parts, Scene& scene,
               const std::function<cv::Point2f(cv::Point2f)>& to_frame);

/// Camera of an image pair: options, else 525 px at 640 px of width and the image centre.
rgbd::CameraModel camera_from_options(int width, int height, const DatasetOptions& options,
                                      const std::string& where);

/// A scan's name from its colour image's or cloud's path: X of X_rgb.png, X.color.jpg, X.pcd.
std::string scan_name(const std::string& path);

/// polo, towel, ... of a file name such as 20150625_2_polo01_1_fold; empty when it names none.
std::string garment_of_name(const std::string& name);

/// Each returns nullptr when the folder holds no file of its kind.
std::unique_ptr<Dataset> open_ctu(const std::string& folder);
std::unique_ptr<Dataset> open_pairs(const std::string& folder, const DatasetOptions& options);
std::unique_ptr<Dataset> open_clouds(const std::string& folder, const DatasetOptions& options);

/// A scene of one colour and one depth image, moved to fit each other.
Scene read_pair(const std::string& name, const std::string& colour, const std::string& depth,
                const DatasetOptions& options);
Scene read_cloud(const std::string& path, const DatasetOptions& options);

}  // namespace weft::dataset
