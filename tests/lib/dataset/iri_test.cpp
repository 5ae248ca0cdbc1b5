#include "dataset/iri.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::dataset {
namespace {

Scene sample() {
  Scene s;
  s.name = "polo-1-v0";
  s.frame.camera = {64, 48, 52.5, 52.25, 31.5, 23.75};
  s.frame.colour = cv::Mat(48, 64, CV_8UC3);
  s.frame.depth = cv::Mat(48, 64, CV_16UC1);
  Random r(1);
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      for (int c = 0; c < 3; ++c) {
        s.frame.colour.at<cv::Vec3b>(y, x)[c] = static_cast<std::uint8_t>(r.below(256));
      }
      s.frame.depth.at<std::uint16_t>(y, x) =
          static_cast<std::uint16_t>(r.below(10) == 0 ? 0 : 700 + r.below(300));
    }
  }
  s.frame.mask = cv::Mat(48, 64, CV_8UC1, cv::Scalar(0));
  s.frame.mask(cv::Rect(10, 10, 20, 20)) = 255;
  s.garment = "polo";
  s.simulation = "1";
  s.split = "train";
  s.easy = true;
  s.single = false;
  s.polygons = {
      {"polo collar", "collar", {{1.5f, 2.25f}, {20.0f, 3.0f}, {12.0f, 30.125f}}, false, 0.75},
      {"polo sleeves", "left", {{40.0f, 2.0f}, {50.0f, 2.0f}, {50.0f, 9.0f}}, true, 0.125}};
  return s;
}

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() &&
         std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

TEST(Iri, SceneComesBackAsWritten) {
  const test::TemporaryFolder folder;
  const Scene s = sample();
  EXPECT_FALSE(is_iri(folder.string()));
  write_iri(folder.string(), s, {});
  ASSERT_TRUE(is_iri(folder.string()));
  const auto dataset = open_iri(folder.string());
  ASSERT_EQ(dataset->names(), std::vector<std::string>{"polo-1-v0"});
  const Scene r = dataset->read(0);
  EXPECT_TRUE(same(r.frame.colour, s.frame.colour));
  EXPECT_TRUE(same(r.frame.depth, s.frame.depth));
  EXPECT_TRUE(same(r.frame.mask, s.frame.mask));
  EXPECT_EQ(r.frame.camera, s.frame.camera);
  EXPECT_EQ(r.garment, s.garment);
  EXPECT_EQ(r.simulation, s.simulation);
  EXPECT_EQ(r.split, s.split);
  EXPECT_EQ(r.easy, s.easy);
  EXPECT_EQ(r.single, s.single);
  ASSERT_EQ(r.polygons.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(r.polygons[i].part, s.polygons[i].part);
    EXPECT_EQ(r.polygons[i].instance, s.polygons[i].instance);
    EXPECT_EQ(r.polygons[i].points, s.polygons[i].points);
    EXPECT_EQ(r.polygons[i].ignore, s.polygons[i].ignore);
    EXPECT_EQ(r.polygons[i].visible_share, s.polygons[i].visible_share);
  }
}

TEST(Iri, ReadsOtherHandsToo) {
  const auto a = parse_iri_annotation(
      "# by hand\r\n"
      "SIZE = 640, 480\r\n"
      "Camera: 525 525 319.5 239.5   # default\r\n"
      "Author: somebody\r\n"
      "\r\n"
      "Part: \"Polo_Collar\"\r\n"
      "polygon: (1, 2); (3, 4)\r\n"
      "polygon: [5 -6.5]\r\n",
      "x.txt");
  ASSERT_TRUE(a.camera);
  EXPECT_EQ(a.camera->width, 640);
  ASSERT_EQ(a.polygons.size(), 1u);
  EXPECT_EQ(a.polygons[0].part, "polo collar");
  ASSERT_EQ(a.polygons[0].points.size(), 3u);
  EXPECT_EQ(a.polygons[0].points[2], cv::Point2f(5.0f, -6.5f));
  EXPECT_EQ(a.polygons[0].visible_share, 1.0);
  EXPECT_TRUE(a.single);
}

TEST(Iri, ErrorsNameFileLineAndWhatWasExpected) {
  const std::pair<const char*, const char*> cases[] = {
      {"size: 640 480\nnonsense\n", "x.txt:2: \"nonsense\": expected key: value"},
      {"instance: left\n", "x.txt:1"},
      {"part: a\npolygon: 1 2 3\n", "x.txt:2"},
      {"part: a\npolygon: 1 2 three 4\n", "expected numbers"},
      {"part: a\npolygon: 1 2, 3 4\n", "polygon of 2 points"},
      {"part: a\nvisible: 1.5\n", "share from 0 to 1"},
      {"part: a\nignore: maybe\n", "yes or no"},
      {"part: a\npolygon: 1 nan 2 inf 3 4\n", "expected numbers"},
      {"camera: 525 525 319.5 239.5\n", "camera: without size:"},
      {"size: 640 480\ncamera: -525 525 319.5 239.5\n", "x.txt"},
      {"size: 1e9 480\n", "width and height"},
  };
  for (const auto& [text, expected] : cases) {
    const std::string error = test::error_of([&] { parse_iri_annotation(text, "x.txt"); });
    EXPECT_NE(error.find(expected), std::string::npos) << text << " -> " << error;
  }
}

TEST(Iri, OneBadSceneLeavesTheOthersReadable) {
  const test::TemporaryFolder folder;
  Scene s = sample();
  write_iri(folder.string(), s, {});
  s.name = "polo-2-v0";
  write_iri(folder.string(), s, {});
  test::write_bytes(folder / "png/polo-1-v0.png", "no image");
  const auto dataset = open_iri(folder.string());
  const std::string error = test::error_of([&] { dataset->read(0); });
  EXPECT_NE(error.find("polo-1-v0.png"), std::string::npos) << error;
  EXPECT_EQ(dataset->read(1).name, "polo-2-v0");
}

TEST(Iri, WithoutCameraLineTheCloudTellsIt) {
  const test::TemporaryFolder folder;
  const Scene s = sample();
  write_iri(folder.string(), s, {});
  const std::string path = folder / "annotations/polo-1-v0.txt";
  std::string text = test::read_bytes(path);
  text.erase(text.find("\ncamera:"), text.find("\ngarment:") - text.find("\ncamera:"));
  test::write_bytes(path, text);
  const Scene r = open_iri(folder.string())->read(0);
  EXPECT_NEAR(r.frame.camera.fx, 52.5, 1e-3);
  EXPECT_NEAR(r.frame.camera.cy, 23.75, 1e-3);
}

}  // namespace
}  // namespace weft::dataset
