// weft-export on a small log with made-up garments: what MAP_OBJECTS says arrives in each file.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "base/text_file.hpp"
#include "mapping/colours.hpp"
#include "mapping/map_picture.hpp"
#include "messages/map.hpp"
#include "messages/map_objects.hpp"
#include "slam/map_file.hpp"
#include "stage/log.hpp"
#include "support/files.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

const std::string kExport = WEFT_BINARY_DIR "/bin/weft-export";

slam::Garment garment(slam::Id id, const Eigen::Vector3d& position_world) {
  slam::Garment out;
  out.id = id;
  out.in_map = true;
  out.position_world = position_world;
  out.covariance = 0.0004 * Eigen::Matrix3d::Identity();
  out.extent_m = 0.25;
  out.supporting_plane = 0;
  out.sightings = 7;
  slam::GarmentPart collar;
  collar.part = "polo collar";
  collar.position_world = position_world + Eigen::Vector3d(0.1, 0.0, -0.05);
  collar.covariance = 0.0001 * Eigen::Matrix3d::Identity();
  collar.probability = 0.8;
  collar.sightings = 6;
  collar.has_grasp = true;
  collar.grasp_score = 0.6;
  collar.approach_world = {0.0, 1.0, 0.0};
  slam::GarmentPart sleeve = collar;
  sleeve.part = "polo sleeve";
  sleeve.position_world = position_world + Eigen::Vector3d(-0.15, 0.0, 0.05);
  sleeve.has_grasp = false;
  out.parts = {collar, sleeve};
  return out;
}

/// A table of 2 x 1.2 m, one metre below the camera and ahead of it, from which points stand up.
slam::Map table() {
  slam::Map map;
  map.version = 1;
  slam::KeyFrame key_frame;
  key_frame.id = 0;
  key_frame.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
  slam::MapPlane plane;
  plane.id = 0;
  plane.normal_world = {0, -1, 0};
  plane.distance_m = -1.0;
  plane.confirmed = true;
  plane.covariance = 1e-4 * Eigen::Matrix3d::Identity();
  for (int i = -10; i <= 10; ++i)
    for (int k = 0; k <= 12; ++k)
      plane.cloud_world.emplace_back(0.1f * static_cast<float>(i), 1.0f,
                                     1.0f + 0.1f * static_cast<float>(k));
  plane.observations = {{0, 0}};
  key_frame.planes.resize(1);
  key_frame.planes[0].plane = 0;
  key_frame.planes[0].segment.plane = {{0, -1, 0}, -1.0};
  for (int i = 0; i < 20; ++i) {
    slam::MapPoint point;
    point.id = i;
    point.position_world = {0.1 * i - 1.0, 0.9, 1.5};
    point.min_distance_m = 0.5;
    point.max_distance_m = 4.0;
    point.observations = {{0, i}};
    point.first_key_frame = 0;
    map.points[i] = point;
    key_frame.features.emplace_back();
    key_frame.points.push_back(i);
  }
  map.key_frames[0] = key_frame;
  map.planes[0] = plane;
  return map;
}

class ExportGarments : public testing::Test {
 protected:
  template <class Message>
  void write(stage::LogWriter& log, const std::string& channel, Message& message,
             std::int64_t seq) {
    message.header.camera = "camera";
    message.header.coordinate_frame = "world";
    message.header.session = 3;
    message.header.seq = seq;
    message.header.utime = 1'000'000 + 100'000 * seq;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    log.write(message.header.utime, channel, bytes);
  }

  /// said: the garments of each frame; spoil: what to change in the last message of them.
  std::string make_log(
      const std::string& name, const std::vector<std::vector<slam::Garment>>& said,
      void (*spoil)(map_objects_t&) = [](map_objects_t&) {}) {
    stage::LogWriter log(folder_ / name);
    const slam::Map map = table();
    map_update_t update{};
    messages::to_message(slam::whole_map(map, 0), 11, map, update);
    update.part_count = 1;
    write(log, "MAP_UPDATE", update, 0);
    for (std::size_t i = 0; i < 3; ++i) {
      const auto seq = static_cast<std::int64_t>(i);
      slam::TrackedFrame tracked;
      tracked.frame = seq;
      tracked.state = slam::TrackingState::kTracked;
      tracked.T_camera_world.translation = {0.1 * static_cast<double>(i), 0, 0};
      tracked.map_version = 1;
      tracked.reference = 0;
      tracked.T_camera_reference = tracked.T_camera_world;
      camera_pose_t pose{};
      messages::to_message(tracked, 0, 11, pose);
      write(log, "CAMERA_POSE", pose, seq);
      if (i >= said.size()) continue;
      map_objects_t objects{};
      messages::to_message({11, 1, std::nullopt, said[i]}, objects);
      if (i + 1 == said.size()) spoil(objects);
      write(log, "MAP_OBJECTS", objects, seq);
    }
    log.close();
    return folder_ / name;
  }
  CommandResult export_all(const std::string& log) {
    return run_command({kExport, "map", log, "--json", folder_ / "map.json", "--obj",
                        folder_ / "map.obj", "--top", folder_ / "top.png", "--oblique",
                        folder_ / "oblique.png"});
  }
  /// Pixels of the garments' own colour, and their middle.
  struct Drawn {
    int pixels = 0;
    double x_px = 0.0, y_px = 0.0;
  };
  Drawn drawn(const std::string& picture) {
    const cv::Mat image = cv::imread(folder_ / picture);
    EXPECT_EQ(image.size(), cv::Size(1200, 900));
    const auto& c = mapping::kGarmentColour;
    const cv::Vec3b colour(static_cast<uchar>(c.blue), static_cast<uchar>(c.green),
                           static_cast<uchar>(c.red));
    Drawn out;
    for (int v = 0; v < image.rows; ++v)
      for (int u = 0; u < image.cols; ++u)
        if (image.at<cv::Vec3b>(v, u) == colour) {
          ++out.pixels;
          out.x_px += u;
          out.y_px += v;
        }
    if (out.pixels > 0) {
      out.x_px /= out.pixels;
      out.y_px /= out.pixels;
    }
    return out;
  }
  test::TemporaryFolder folder_;
};

TEST_F(ExportGarments, OfASavedMapToo) {
  slam::SavedMap saved;
  saved.map = table();
  saved.next = {1, 20, 1};
  saved.garments = {{garment(2, {0.5, 0.95, 1.4})}, 3};
  slam::write_map(folder_ / "room.map", saved);
  const auto result = export_all(folder_ / "room.map");
  ASSERT_EQ(result.status, 0) << result.output;
  const auto json = nlohmann::json::parse(read_text_file(folder_ / "map.json"));
  ASSERT_EQ(json.at("garments").size(), 1u);
  EXPECT_EQ(json.at("garments")[0].at("parts").size(), 2u);
}

TEST(UpDirection, IsThatOfTheGarmentsPlaneWhereverTheCameraLooks) {
  mapping::MapContent content;
  content.map = table();
  // It looks straight down on the table: no plane is near its own up.
  content.map.key_frames[0].T_camera_world.rotation =
      Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitX());
  EXPECT_LT(mapping::up_direction(content).dot(Eigen::Vector3d(0, -1, 0)), 0.1);
  content.garments = {garment(0, {0.5, 0.95, 1.4})};
  EXPECT_GT(mapping::up_direction(content).dot(Eigen::Vector3d(0, -1, 0)), 0.999);
  content.garments[0].in_map = false;
  EXPECT_LT(mapping::up_direction(content).dot(Eigen::Vector3d(0, -1, 0)), 0.1);
}

TEST(Pictures, ShowGarmentsFarFromAllElse) {
  mapping::MapContent content;
  content.map = table();
  content.garments = {garment(0, {9.0, 0.95, 1.4})};
  for (const cv::Mat& picture :
       {mapping::top_picture(content), mapping::oblique_picture(content)}) {
    cv::Mat drawn;  // the garment's circle, whole
    const cv::Scalar colour(mapping::kGarmentColour.blue, mapping::kGarmentColour.green,
                            mapping::kGarmentColour.red);
    cv::inRange(picture, colour, colour, drawn);
    const cv::Rect box = cv::boundingRect(drawn);
    EXPECT_GT(box.area(), 100);
    EXPECT_GT(box.x, 0);
    EXPECT_GT(box.y, 0);
    EXPECT_LT(box.br().x, picture.cols);
    EXPECT_LT(box.br().y, picture.rows);
  }
}

TEST_F(ExportGarments, ReachEveryFile) {
  slam::Garment candidate = garment(5, {0.6, 0.95, 1.9});
  candidate.in_map = false;
  // As the last message has them: in the first the garment was elsewhere, and another one there.
  const auto result = export_all(
      make_log("garments.lcm", {{garment(1, {-0.5, 0.95, 1.2}), garment(2, {-0.9, 0.95, 1.2})},
                                {garment(2, {0.5, 0.95, 1.4}), candidate}}));
  ASSERT_EQ(result.status, 0) << result.output;
  EXPECT_NE(result.output.find("1 planes, 1 garments; 3 poses"), std::string::npos)
      << result.output;

  const auto json = nlohmann::json::parse(read_text_file(folder_ / "map.json"));
  ASSERT_EQ(json.at("garments").size(), 2u);
  const auto& first = json.at("garments")[0];
  EXPECT_EQ(first.at("id"), 2);
  EXPECT_EQ(first.at("in_map"), true);
  EXPECT_EQ(first.at("position_m"), nlohmann::json({0.5, 0.95, 1.4}));
  EXPECT_NEAR(first.at("sigma_m").get<double>(), 0.02, 1e-12);
  EXPECT_EQ(first.at("extent_m"), 0.25);
  EXPECT_EQ(first.at("supporting_plane"), 0);
  EXPECT_EQ(first.at("sightings"), 7);
  ASSERT_EQ(first.at("parts").size(), 2u);
  const auto& collar = first.at("parts")[0];
  EXPECT_EQ(collar.at("part"), "polo collar");
  EXPECT_NEAR(collar.at("position_m")[0].get<double>(), 0.6, 1e-12);
  EXPECT_NEAR(collar.at("position_m")[2].get<double>(), 1.35, 1e-12);
  EXPECT_NEAR(collar.at("sigma_m").get<double>(), 0.01, 1e-12);
  EXPECT_EQ(collar.at("probability"), 0.8);
  EXPECT_EQ(collar.at("grasp").at("score"), 0.6);
  EXPECT_EQ(collar.at("grasp").at("approach"), nlohmann::json({0.0, 1.0, 0.0}));
  EXPECT_FALSE(first.at("parts")[1].contains("grasp"));
  EXPECT_EQ(json.at("garments")[1].at("id"), 5);
  EXPECT_EQ(json.at("garments")[1].at("in_map"), false);

  // Names, and each a point element whose vertex is the place; candidates are not in it.
  std::istringstream obj(read_text_file(folder_ / "map.obj"));
  std::vector<Eigen::Vector3d> vertices;
  std::map<std::string, Eigen::Vector3d> places;
  std::string name;
  for (std::string line; std::getline(obj, line);) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "v") {
      vertices.emplace_back();
      words >> vertices.back().x() >> vertices.back().y() >> vertices.back().z();
    }
    if (kind == "o") words >> name;
    std::size_t number = 0;
    if (kind == "p" && words >> number) {
      ASSERT_LE(number, vertices.size()) << line;
      places[name] = vertices[number - 1];
    }
  }
  EXPECT_EQ(places.size(), 4u);  // the points as well
  EXPECT_EQ(places["garment_2"], Eigen::Vector3d(0.5, 0.95, 1.4));
  EXPECT_LT((places["garment_2_polo_collar"] - Eigen::Vector3d(0.6, 0.95, 1.35)).norm(), 1e-6);
  EXPECT_LT((places["garment_2_polo_sleeve"] - Eigen::Vector3d(0.35, 0.95, 1.45)).norm(), 1e-6);

  // The camera looks along z: from above, right of the middle is +x. The table fills the width.
  EXPECT_GT(drawn("top.png").pixels, 300);
  EXPECT_GT(drawn("top.png").x_px, 700.0);
  EXPECT_GT(drawn("oblique.png").pixels, 300);
}

TEST_F(ExportGarments, AreNotMadeUp) {
  slam::Garment candidate = garment(5, {0.6, 0.95, 1.9});
  candidate.in_map = false;
  for (const auto& log : {make_log("none.lcm", {}), make_log("candidate.lcm", {{candidate}})}) {
    const auto result = export_all(log);
    ASSERT_EQ(result.status, 0) << result.output;
    EXPECT_NE(result.output.find("0 garments"), std::string::npos) << result.output;
    EXPECT_EQ(read_text_file(folder_ / "map.obj").find("garment"), std::string::npos);
    EXPECT_EQ(drawn("top.png").pixels, 0);
    EXPECT_EQ(drawn("oblique.png").pixels, 0);
  }
}

TEST_F(ExportGarments, WhatCannotBeIsRefusedByName) {
  const auto result =
      export_all(make_log("garbage.lcm", {{garment(2, {0.5, 0.95, 1.4})}},
                          [](map_objects_t& m) { m.objects[0].parts[1].probability = 1.5; }));
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.output.find("garment 2"), std::string::npos) << result.output;
  EXPECT_NE(result.output.find("probability"), std::string::npos) << result.output;

  // A message that failed says nothing: the one before it holds.
  const auto failed =
      export_all(make_log("failed.lcm", {{garment(2, {0.5, 0.95, 1.4})}, {}},
                          [](map_objects_t& m) { m.status.code = status_t::FAILED; }));
  ASSERT_EQ(failed.status, 0) << failed.output;
  EXPECT_NE(failed.output.find("1 garments"), std::string::npos) << failed.output;
}

}  // namespace
}  // namespace weft
