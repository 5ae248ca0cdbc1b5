#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <opencv2/imgproc.hpp>

#include "dataset/scene.hpp"
#include "foreground/foreground.hpp"
#include "support/files.hpp"
#include "support/table_scene.hpp"

namespace weft::foreground {
namespace {

/// The outline the annotators drew: straight lines between the garment's corners. Nodes between the
/// two ends of a fold ("fold_1" ... "fold_1") outline the flap that lies on the rest.
cv::Mat ctu_outline(const dataset::Scene& scene, const std::string& folder) {
  const YAML::Node yaml = YAML::LoadFile(folder + "/cloA" + scene.name + ".yaml");
  std::vector<std::string> names;
  for (const auto& name : yaml["node_names"]) names.push_back(name[0].as<std::string>());
  std::vector<cv::Point> nodes;
  for (const cv::Point2f& p : scene.outline)
    nodes.push_back({cvRound(p.x * 16), cvRound(p.y * 16)});
  cv::Mat mask = cv::Mat::zeros(480, 640, CV_8UC1);
  const auto fill = [&](const std::vector<cv::Point>& polygon) {
    cv::fillPoly(mask, std::vector<std::vector<cv::Point>>{polygon}, 255, cv::LINE_8, 4);
  };
  std::vector<cv::Point> rest;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    rest.push_back(nodes[i]);
    if (names[i].rfind("fold", 0) != 0) continue;
    const auto end = std::find(names.begin() + static_cast<long>(i) + 1, names.end(), names[i]);
    if (end == names.end()) continue;
    const auto last = end - names.begin();
    fill({nodes.begin() + static_cast<long>(i), nodes.begin() + last + 1});
    i = static_cast<std::size_t>(last) - 1;
  }
  fill(rest);
  return mask;
}

TEST(RealScans, AgreeWithTheCtuOutlines) {
  const std::string folder = (test::data_folder() / "ctu-garments-3").string();
  WEFT_NEEDS_DATA(folder);
  const auto scans = dataset::open_dataset(folder);
  ASSERT_EQ(scans->names().size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const dataset::Scene scene = scans->read(i);
    const Foreground found = find_foreground(scene.frame, {});
    ASSERT_TRUE(found.table);
    EXPECT_LT(found.table->distance_m, -1.0);
    EXPECT_GT(found.table->distance_m, -1.25);
    const double iou = test::iou(found.mask, ctu_outline(scene, folder));
    RecordProperty("iou_" + scene.name, std::to_string(iou));
    std::printf("CTU %s: IoU %.3f\n", scene.name.c_str(), iou);
    EXPECT_GE(iou, 0.85) << scene.name;
  }
}

TEST(RealScans, ShowOneTableUnderTheTowelsAndBlankets) {
  const std::string folder = (test::data_folder() / "uc3m-garments/pcd").string();
  WEFT_NEEDS_DATA(folder);
  const auto scans = dataset::open_dataset(folder);
  ASSERT_EQ(scans->names().size(), 10u);
  for (std::size_t i = 0; i < 10; ++i) {
    const rgbd::RgbdFrame frame = scans->read(i).frame;
    const std::string name = scans->names()[i];
    const Foreground found = find_foreground(frame, {});
    ASSERT_TRUE(found.table) << name;
    // The camera stood still: all ten tables are one.
    EXPECT_NEAR(found.table->distance_m, -1.052, 0.006) << name;
    EXPECT_NEAR(found.table->normal.z(), -0.9937, 0.002) << name;
    const double share = cv::countNonZero(found.mask) / (640.0 * 480.0);
    EXPECT_GT(share, 0.2) << name;
    EXPECT_LT(share, 0.6) << name;
    // One cloth, with nothing of the image's corners
    cv::Mat labels, stats, centres;
    EXPECT_EQ(cv::connectedComponentsWithStats(found.mask, labels, stats, centres), 2) << name;
    for (const auto& [u, v] : {std::pair{0, 0}, {639, 0}, {0, 479}, {639, 479}})
      EXPECT_EQ(found.mask.at<std::uint8_t>(v, u), 0) << name;
  }
}

}  // namespace
}  // namespace weft::foreground
