#pragma once

#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "rgbd/frame.hpp"

/// Depth images whose planes are labelled by hand or by the renderer.
namespace weft::dataset {

struct PlaneScan {
  std::string name;
  rgbd::RgbdFrame frame;  // without colour
  cv::Mat truth;  // CV_8UC1 of its size: 0 = no plane, else the plane's number, 1 ...; empty
                  // when it is not known
};

struct PlaneScanFile {
  std::string name, depth, truth;  // paths; truth is empty when there is none
  rgbd::CameraModel camera;
  double depth_unit_m = 0.0002;
  bool along_ray_cm = false;  // depth is a text of distances along the ray in cm (POV-Ray)
};

/// Depth images in a folder and its folders, by name:
///   NAME.png + planes_..., K     depth_N.png with planes_N.png, 16 bit, 0.2 mm a count, and one
///                                file *.K with the 3 x 3 camera matrix beside them
///   NAME.depth(.gz)              text of 640 x 480 distances along the ray in cm, with
///                                planes_NAME.png; ICL-NUIM's camera, 481.2 x 480 px
/// ICL-NUIM's negative focal length fy (a picture taken upwards) is taken as positive: everything
/// is mirrored, which changes no angle and no distance. Throws Error when there is none.
std::vector<PlaneScanFile> list_plane_scans(const std::string& folder);

/// Throws Error naming the file and the reason.
PlaneScan read_plane_scan(const PlaneScanFile& file);

}  // namespace weft::dataset
