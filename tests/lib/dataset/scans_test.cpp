#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "dataset/readers.hpp"
#include "dataset/scene.hpp"
#include "rgbd/pcd_io.hpp"
#include "support/files.hpp"

namespace weft::dataset {
namespace {

using test::error_of;
using test::TemporaryFolder;
using test::write_bytes;

cv::Mat colour_image(int width, int height) {
  cv::Mat image(height, width, CV_8UC3);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      image.at<cv::Vec3b>(v, u) = {static_cast<std::uint8_t>(u), static_cast<std::uint8_t>(v), 77};
  return image;
}

cv::Mat depth_image(int width, int height) {
  cv::Mat image(height, width, CV_16UC1);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      image.at<std::uint16_t>(v, u) =
          static_cast<std::uint16_t>((u + v) % 11 == 0 ? 0 : 800 + u + 2 * v);
  return image;
}

/// A CTU-like scene: colour 1280x1024 and depth 640x480, in small.
void write_ctu(const TemporaryFolder& folder, const std::string& name) {
  cv::imwrite(folder / ("cloC" + name + ".png"), colour_image(128, 102));
  cv::imwrite(folder / ("cloD" + name + ".png"), depth_image(64, 48));
  write_bytes(folder / ("cloA" + name + ".yaml"),
              "path_c: cloC" + name + ".png\npath_d: cloD" + name +
                  ".png\ntype: pants\npoly_c:\n- [20.5, 13.5]\n- [100.5, 13.5]\n- [60.5, 83.5]\n");
}

TEST(Ctu, ColourIsCroppedAndHalvedToFitTheDepth) {
  const TemporaryFolder folder;
  write_ctu(folder, "00001");
  write_bytes(folder / "parts.json",
              R"({"scenes": {"00001": {"jeans hips": [[[20.5,13.5],[40.5,13.5],[30.5,33.5]]],
                 "ignore": {"jeans pants hemline": "folded"}}}})");
  const auto set = open_dataset(folder.string());
  ASSERT_EQ(set->names(), std::vector<std::string>{"00001"});
  const Scene scene = set->read(0);
  EXPECT_EQ(scene.garment, "jeans");
  EXPECT_EQ(scene.frame.camera, (rgbd::CameraModel{64, 48, 52.5, 52.5, 31.5, 23.5}));
  // Depth px (u, v) shows the colour px 2u, 2u+1 and 3+2v, 4+2v: the centred crop.
  for (const auto& [u, v] : {std::pair{0, 0}, {10, 20}, {63, 47}}) {
    const cv::Vec3b bgr = scene.frame.colour.at<cv::Vec3b>(v, u);
    EXPECT_NEAR(bgr[0], 2 * u + 0.5, 0.51);
    EXPECT_NEAR(bgr[1], 3 + 2 * v + 0.5, 0.51);
  }
  EXPECT_EQ(scene.outline[0], cv::Point2f(10.0f, 5.0f));
  ASSERT_EQ(scene.polygons.size(), 2u);
  EXPECT_EQ(scene.polygons[0].part, "jeans hips");
  EXPECT_EQ(scene.polygons[0].points[0], cv::Point2f(10.0f, 5.0f));
  EXPECT_TRUE(scene.polygons[1].ignore);
  EXPECT_EQ(scene.polygons[1].points, scene.outline);
}

TEST(Ctu, ABrokenSceneIsAnErrorAndTheOthersGoOn) {
  const TemporaryFolder folder;
  for (const char* name : {"1", "2", "3", "4", "5", "6", "7"}) write_ctu(folder, name);
  std::filesystem::remove(folder / "cloD1.png");
  const std::string png = test::read_bytes(folder / "cloC2.png");
  write_bytes(folder / "cloC2.png", png.substr(0, png.size() / 2));
  cv::imwrite(folder / "cloC3.png", colour_image(100, 102));
  write_bytes(folder / "cloA4.yaml", "path_c: ../cloC4.png\n");
  write_bytes(folder / "cloA5.yaml", "path_c: [1,");
  write_bytes(folder / "cloA6.yaml",
              "path_c: cloC6.png\npath_d: cloD6.png\npoly_c:\n- [.nan, 1]\n");
  const auto set = open_dataset(folder.string());
  const std::pair<const char*, const char*> reasons[] = {
      {"cloD1.png", "cannot be opened"}, {"cloC2.png", "does not decode"},
      {"cloC3.png", "twice the size"},   {"cloA4.yaml", "path_c must be the name"},
      {"cloA5.yaml", "yaml-cpp"},        {"cloA6.yaml", "not finite"},
  };
  for (std::size_t i = 0; i < 6; ++i) {
    const std::string error = error_of([&] { set->read(i); });
    EXPECT_EQ(error.find(folder / reasons[i].first), 0u) << error;
    EXPECT_NE(error.find(reasons[i].second), std::string::npos) << error;
  }
  EXPECT_EQ(set->read(6).name, "7");
}

TEST(Pairs, AreFoundUnderTheirUsualNames) {
  const TemporaryFolder folder;
  cv::imwrite(folder / "polo01_rgb.png", colour_image(64, 48));
  cv::imwrite(folder / "polo01_depth.png", depth_image(64, 48));
  cv::imwrite(folder / "frame-000001.color.jpg", colour_image(32, 24));
  cv::imwrite(folder / "frame-000001.depth.png", depth_image(32, 24));
  std::filesystem::create_directories(folder / "rgb");
  std::filesystem::create_directories(folder / "depth");
  cv::imwrite(folder / "rgb/0001.png", colour_image(128, 72));
  cv::imwrite(folder / "depth/0001.png", depth_image(128, 72));
  const auto set =
      open_dataset(folder.string(), {.fx_px = 60.0, .cx_px = 30.0, .depth_unit_m = 0.0002});
  ASSERT_EQ(set->names(), (std::vector<std::string>{"0001", "frame-000001", "polo01"}));
  EXPECT_EQ(set->read(0).frame.camera, (rgbd::CameraModel{128, 72, 60.0, 60.0, 30.0, 35.5}));
  EXPECT_EQ(set->read(2).garment, "polo");
  EXPECT_EQ(set->read(1).frame.colour.size(), cv::Size(32, 24));
  EXPECT_EQ(set->read(2).frame.depth_unit_m, 0.0002);
}

TEST(Pairs, AnOffsetMovesTheDepthToTheColour) {
  const TemporaryFolder folder;
  const cv::Mat depth = depth_image(64, 48);
  cv::imwrite(folder / "a_rgb.png", colour_image(64, 48));
  cv::imwrite(folder / "a_depth.png", depth);
  DatasetOptions options;
  options.registration_offset_px = {-6, 2};
  const Scene scene = open_dataset(folder.string(), options)->read(0);
  // Moved by (-6, 2), the colour at (26, 8) comes to where the depth is (20, 10).
  EXPECT_EQ(scene.frame.depth.at<std::uint16_t>(8, 26), depth.at<std::uint16_t>(10, 20));
  EXPECT_EQ(scene.frame.depth.at<std::uint16_t>(8, 3), 0);
  options.registration_scale = 0.5;
  options.registration_offset_px = {0, 0};
  const Scene half = open_dataset(folder.string(), options)->read(0);
  EXPECT_EQ(half.frame.depth.at<std::uint16_t>(2, 2), 0);
  EXPECT_NEAR(half.frame.depth.at<std::uint16_t>(20, 41), 800 + 50.5 + 2 * 16.5, 3);
  options.registration_offset_px = {1};
  EXPECT_NE(error_of([&] { open_dataset(folder.string(), options); }).find("needs x and y"),
            std::string::npos);
}

TEST(Pairs, WhatDoesNotFitIsAnErrorThatNamesTheFile) {
  const TemporaryFolder folder;
  const auto error_with = [&](const std::function<void()>& damage) {
    cv::imwrite(folder / "a_rgb.png", colour_image(64, 48));
    cv::imwrite(folder / "a_depth.png", depth_image(64, 48));
    damage();
    return error_of([&] { open_dataset(folder.string())->read(0); });
  };
  EXPECT_EQ(error_with([] {}), "");
  const std::string depth = folder / "a_depth.png";
  EXPECT_EQ(error_with([&] { std::filesystem::remove(depth); }),
            depth + ": cannot be opened as a file");
  EXPECT_EQ(error_with([&] { write_bytes(depth, ""); }),
            depth + ": neither a PNG nor a JPEG image");
  EXPECT_EQ(error_with([&] { cv::imwrite(depth, colour_image(64, 48)); }),
            depth + ": 3 channels of 8 bits, expected a depth image: 1 channel of 16 bits");
  EXPECT_EQ(error_with([&] { cv::imwrite(depth, depth_image(64, 47)); }),
            depth + ": 64x47 px, but the colour image " + (folder / "a_rgb.png") + " has 64x48");
  // A header that claims four billion pixels must not be believed.
  std::string huge = test::read_bytes(depth);
  for (int i = 16; i < 24; ++i) huge[static_cast<std::size_t>(i)] = '\xff';
  EXPECT_NE(error_with([&] { write_bytes(depth, huge); }).find("is not within"), std::string::npos);
}

TEST(Pairs, FlippedBitsAreErrorsOrImagesOfTheSameSize) {
  const TemporaryFolder folder;
  cv::imwrite(folder / "a_rgb.png", colour_image(64, 48));
  cv::imwrite(folder / "a_depth.png", depth_image(64, 48));
  const std::string good = test::read_bytes(folder / "a_depth.png");
  Random random(1);
  int errors = 0;
  for (int run = 0; run < 40; ++run) {
    std::string damaged = good;
    damaged[random.below(damaged.size())] ^= static_cast<char>(1 << random.below(8));
    write_bytes(folder / "a_depth.png", damaged);
    errors +=
        !error_of([&] {
           EXPECT_EQ(open_dataset(folder.string())->read(0).frame.depth.size(), cv::Size(64, 48));
         }).empty();
  }
  EXPECT_GT(errors, 20);
}

TEST(Clouds, OrganisedOnesAreScenesAndOthersErrors) {
  const TemporaryFolder folder;
  rgbd::RgbdFrame frame;
  frame.camera = {64, 48, 50.0, 51.0, 30.0, 24.0};
  frame.colour = colour_image(64, 48);
  frame.depth = depth_image(64, 48);
  rgbd::Cloud cloud = rgbd::cloud_from_frame(frame);
  write_pcd(folder / "towel01.pcd", cloud, rgbd::PcdEncoding::kBinaryCompressed);
  cloud.width = 64 * 48;
  cloud.height = 1;
  cloud.colour = cv::Mat();
  write_pcd(folder / "points.pcd", cloud, rgbd::PcdEncoding::kAscii);
  const auto set = open_dataset(folder.string());
  ASSERT_EQ(set->names(), (std::vector<std::string>{"points", "towel01"}));
  EXPECT_NE(error_of([&] { set->read(0); }).find("points.pcd: the cloud is not organised"),
            std::string::npos);
  const Scene scene = set->read(1);
  EXPECT_EQ(scene.garment, "towel");
  EXPECT_EQ(0, std::memcmp(scene.frame.depth.data, frame.depth.data, 64 * 48 * 2));
  EXPECT_EQ(0, std::memcmp(scene.frame.colour.data, frame.colour.data, 64 * 48 * 3));
  EXPECT_NEAR(scene.frame.camera.fy, 51.0, 1e-4);
  EXPECT_EQ(open_scan(folder / "towel01.pcd", "")->names()[0], "towel01");
}

TEST(Datasets, AFolderWithoutScansSaysWhatWasLookedFor) {
  const TemporaryFolder folder;
  EXPECT_NE(error_of([&] { open_dataset(folder.string()); }).find("cloA*.yaml"), std::string::npos);
  EXPECT_NE(error_of([&] { open_dataset(folder / "none"); }).find("is not a folder"),
            std::string::npos);
}

TEST(PartsFile, MistakesAreNamed) {
  const TemporaryFolder folder;
  const std::string path = folder / "parts.json";
  const std::pair<const char*, const char*> cases[] = {
      {"{", "not valid JSON"},
      {"[]", "\"scenes\" is missing"},
      {R"({"scenes": {"a": 1}})", "scene a must hold an object"},
      {R"({"scenes": {"a": {"hips": 1}}})", "part hips: a list of polygons"},
      {R"({"scenes": {"a": {"hips": [[[1,2],[3,4]]]}}})", "three points or more"},
      {R"({"scenes": {"a": {"hips": [[[1,2],[3,4],[5]]]}}})", "must be [x, y]"},
      {R"({"scenes": {"a": {"hips": [[[1,2],[3,4],[5,1e30]]]}}})", "far outside"},
      {R"({"scenes": {"a": {"ignore": []}}})", "\"ignore\" must be"},
  };
  for (const auto& [text, reason] : cases) {
    write_bytes(path, text);
    const std::string error = error_of([&] { read_parts_file(path); });
    EXPECT_EQ(error.find(path), 0u) << error;
    EXPECT_NE(error.find(reason), std::string::npos) << error;
  }
}

double share_inside(const cv::Mat& mask, const std::vector<cv::Point2f>& polygon) {
  cv::Mat inside(mask.size(), CV_8UC1, cv::Scalar(0));
  std::vector<cv::Point> points(polygon.begin(), polygon.end());
  cv::fillPoly(inside, std::vector{points}, cv::Scalar(255));
  return static_cast<double>(cv::countNonZero(inside & mask)) / cv::countNonZero(inside);
}

TEST(RealScans, CtuPolygonsLieOnTheGarment) {
  const auto folder = test::data_folder() / "ctu-garments-3";
  WEFT_NEEDS_DATA(folder);
  const auto set = open_dataset(folder.string());
  ASSERT_EQ(set->names(), (std::vector<std::string>{"00023", "01158", "02321"}));
  const Scene scene = set->read(0);
  EXPECT_EQ(scene.frame.colour.size(), cv::Size(640, 480));
  ASSERT_EQ(scene.outline.size(), 7u);
  ASSERT_EQ(scene.polygons.size(), 3u);
  // The trousers are black.
  cv::Mat grey, dark;
  cv::cvtColor(scene.frame.colour, grey, cv::COLOR_BGR2GRAY);
  dark = grey < 60;
  EXPECT_GT(share_inside(dark, scene.outline), 0.85);
  for (const PartPolygon& polygon : scene.polygons)
    EXPECT_GT(share_inside(dark, polygon.points), 0.8) << polygon.part;
  EXPECT_LT(cv::countNonZero(dark & (scene.frame.depth > 0)), 100000);
}

TEST(RealScans, Uc3mPairsAndCloudsRead) {
  const auto folder = test::data_folder() / "uc3m-garments";
  WEFT_NEEDS_DATA(folder);
  const auto pairs = open_dataset(folder.string());
  ASSERT_EQ(pairs->names().size(), 6u);
  const Scene polo = pairs->read(2);
  ASSERT_EQ(polo.name, "20150625_2_polo01_1_fold");
  EXPECT_EQ(polo.polygons.size(), 3u);
  const auto clouds = open_dataset((folder / "pcd").string());
  ASSERT_EQ(clouds->names().size(), 10u);
  for (std::size_t i = 0; i < clouds->names().size(); ++i) {
    const Scene scene = clouds->read(i);
    EXPECT_NEAR(scene.frame.camera.fx, 525.0, 1e-3) << scene.name;
    EXPECT_NEAR(scene.frame.camera.cx, 319.5, 1e-3) << scene.name;
    EXPECT_NE(scene.garment, "") << scene.name;
    EXPECT_GT(cv::countNonZero(scene.frame.depth), 200000) << scene.name;
  }
}

TEST(RealScans, OtherFoldersRead) {
  const auto data = test::data_folder();
  WEFT_NEEDS_DATA(data / "7scenes-redkitchen-200");
  const auto kitchen = open_dataset((data / "7scenes-redkitchen-200").string(), {.fx_px = 585.0});
  EXPECT_EQ(kitchen->names().size(), 200u);
  EXPECT_EQ(kitchen->read(7).frame.camera.fx, 585.0);
  const auto cabinet = open_dataset((data / "tum-fr3-cabinet-58").string(), {.depth_unit_m = 2e-4});
  EXPECT_EQ(cabinet->names().size(), 58u);
  EXPECT_EQ(cabinet->read(0).frame.depth_unit_m, 2e-4);
}

}  // namespace
}  // namespace weft::dataset
