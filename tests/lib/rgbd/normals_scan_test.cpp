#include <gtest/gtest.h>

#include "rgbd/normals.hpp"
#include "rgbd/pcd_io.hpp"
#include "support/files.hpp"
#include "support/plain_normals.hpp"

namespace weft::rgbd {
namespace {

TEST(NormalsOfAScan, AreThoseOfTheDefinition) {
  for (const char* file :
       {"pcl-scans/office1.pcd", "uc3m-garments/pcd/20150902_towel02_2_fold.pcd"}) {
    const auto path = test::data_folder() / file;
    WEFT_NEEDS_DATA(path);
    const Cloud cloud = read_pcd(path);
    const auto fit = fit_camera(cloud, path);
    const RgbdFrame frame = frame_from_cloud(cloud, fit.camera, 0.0001, path);
    // A part of the frame with holes and edges.
    const cv::Rect crop(230, 150, 180, 130);
    RgbdFrame part = frame;
    part.camera.width = crop.width;
    part.camera.height = crop.height;
    part.camera.cx -= crop.x;
    part.camera.cy -= crop.y;
    part.depth = frame.depth(crop).clone();
    View view;
    view.width = crop.width;
    view.height = crop.height;
    view.sensor = part.camera;
    const Surface surface = render_surface(part, view);
    const NormalOptions options;
    const cv::Mat normals = estimate_normals(surface, options, 2);
    EXPECT_GT(test::expect_plain_normals(normals, surface, options, {0, 0, 180, 130}, 4), 500);
  }
}

}  // namespace
}  // namespace weft::rgbd
