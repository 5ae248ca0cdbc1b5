// weft-planes, weft-track and weft-map together, under their real runners.
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "base/error.hpp"
#include "messages/detections.hpp"
#include "messages/foreground.hpp"
#include "messages/grasp.hpp"
#include "messages/map.hpp"
#include "messages/map_objects.hpp"
#include "messages/planes.hpp"
#include "messages/rgbd.hpp"
#include "procs/map/stage.hpp"
#include "procs/planes/stage.hpp"
#include "procs/track/stage.hpp"
#include "slam/map_file.hpp"
#include "stage/in_process.hpp"
#include "support/files.hpp"
#include "support/textured_room.hpp"
#include "weft/camera_in_base_t.hpp"

namespace weft {
namespace {

using Bytes = std::vector<std::uint8_t>;

template <class Message>
Message decode(const Bytes& bytes) {
  Message message{};
  EXPECT_EQ(message.decode(bytes.data(), 0, static_cast<int>(bytes.size())),
            static_cast<int>(bytes.size()));
  return message;
}

template <class Message>
Bytes encode(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

Settings settings(const std::string& text) { return Settings::from_text(text, "test"); }

/// Frames of the room, every third of 30 a second, rendered once.
const std::vector<Bytes>& frames() {
  static const std::vector<Bytes> all = [] {
    std::vector<Bytes> out;
    const test::TexturedRoom room;
    for (int i = 0; i < 14; ++i) {
      rgbd_frame_t message{};
      messages::to_message(room.render(test::TexturedRoom::path(0.1 * i)), {}, message);
      message.header = {};
      message.header.camera = "camera";
      message.header.session = 3;
      message.header.seq = i;
      message.header.utime = 1'000'000 + 100'000 * i;
      out.push_back(encode(message));
    }
    return out;
  }();
  return all;
}

struct Play {
  explicit Play(const std::string& track = "", const std::string& mapper = "")
      : track_settings("vocabulary: ''\n" + track), map_settings("vocabulary: ''\n" + mapper) {
    set.add(planes_process::make_stage(settings("")), "planes");
    tracker = track_process::make_stage(settings(track_settings));
    set.add(tracker, "track");
    set.add(map_process::make_stage(settings(map_settings)), "map");
    set.observe([this](const std::string& channel, const Bytes& bytes) {
      if (channel == "STAGE_TIMING" || channel == "STAGE_STATUS") return;
      said.emplace_back(channel, bytes);
      if (channel == "CAMERA_POSE") poses.push_back(decode<camera_pose_t>(bytes));
      if (channel == "KEYFRAME") key_frames.push_back(decode<keyframe_t>(bytes));
      if (channel == "MAP_UPDATE") updates.push_back(decode<map_update_t>(bytes));
    });
  }
  void play(std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      set.inject("RGBD_FRAME", frames()[i]);
      set.run();
    }
  }
  std::string track_settings, map_settings;
  std::shared_ptr<stage::Stage> tracker;
  stage::InProcess set;
  std::vector<std::pair<std::string, Bytes>> said;
  std::vector<camera_pose_t> poses;
  std::vector<keyframe_t> key_frames;
  std::vector<map_update_t> updates;  // part by part
};

double error_m(const camera_pose_t& pose) {
  const auto truth = test::TexturedRoom::path(1e-6 * static_cast<double>(pose.header.utime) - 1.0);
  return (messages::from_message(pose.T_world_camera, "test").translation - truth.translation)
      .norm();
}

TEST(MapStages, FollowTheCamera) {
  Play run;
  run.play(0, frames().size());
  ASSERT_EQ(run.poses.size(), frames().size());
  ASSERT_EQ(run.key_frames.size(), frames().size());
  EXPECT_EQ(run.key_frames[0].is_key_frame, 1);
  for (const auto& pose : run.poses) {
    ASSERT_EQ(int{pose.state}, int{camera_pose_t::TRACKED}) << pose.header.seq << pose.reason;
    EXPECT_EQ(pose.header.coordinate_frame, "world");
    EXPECT_LT(error_m(pose), 0.02) << pose.header.seq;
    EXPECT_EQ(pose.tracker_session, 0);
    EXPECT_EQ(pose.map_version > 0, pose.map_id != 0);
  }
  EXPECT_GE(run.poses.back().planes, 3);
  // Every frame has been answered, and the newest map holds the key frames that were made.
  int made = 0;
  for (const auto& each : run.key_frames) made += each.is_key_frame;
  const auto& last = run.updates.back();
  EXPECT_EQ(last.key_frame_count, made);
  EXPECT_GT(last.point_count, 200);
  EXPECT_GE(last.plane_count, 3);
  EXPECT_EQ(last.refused, "");
}

TEST(MapStages, TwoRunsSayTheSame) {
  Play a, b;
  a.play(0, 6);
  b.play(0, 6);
  ASSERT_EQ(a.said.size(), b.said.size());
  for (std::size_t i = 0; i < a.said.size(); ++i) EXPECT_EQ(a.said[i], b.said[i]) << i;
}

TEST(MapStages, UpdatesStandForThemselvesAcrossLongerDelays) {
  Play run("map_delay: 3\n");
  run.play(0, frames().size());
  for (const auto& pose : run.poses)
    EXPECT_EQ(int{pose.state}, int{camera_pose_t::TRACKED}) << pose.header.seq << pose.reason;
  // What was said of frame n is known at frame n + 3.
  EXPECT_EQ(run.poses[2].map_version, 0);
  EXPECT_GT(run.poses[3].map_version, 0);
  for (const auto& update : run.updates) EXPECT_EQ(update.refused, "") << update.header.seq;
  EXPECT_LT(error_m(run.poses.back()), 0.02);
}

/// Runs each stage by hand, so that one can be exchanged on the way.
struct ByHand {
  std::shared_ptr<stage::Stage> planes = planes_process::make_stage(settings(""));
  std::shared_ptr<stage::Stage> tracker = make_tracker();
  std::shared_ptr<stage::Stage> mapper = make_mapper();
  camera_pose_t pose;
  keyframe_t key_frame;
  map_update_t map_update;

  static std::shared_ptr<stage::Stage> make_tracker() {
    return track_process::make_stage(settings("vocabulary: ''\n"));
  }
  static std::shared_ptr<stage::Stage> make_mapper() {
    return map_process::make_stage(settings("vocabulary: ''\n"));
  }
  template <class Message>
  static std::shared_ptr<Message> share(const Message& message) {
    return std::make_shared<Message>(message);
  }
  void play(std::size_t index, std::int64_t session = 3) {
    const auto rgbd = share(decode<rgbd_frame_t>(frames()[index]));
    rgbd->header.session = session;
    const header_t header = rgbd->header;
    const auto run = [&](stage::Stage& stage, const std::vector<std::shared_ptr<void>>& given,
                         std::vector<std::shared_ptr<void>> filled) {
      const auto& interface = stage.interface();
      std::vector<std::pair<const stage::Port*, std::shared_ptr<void>>> in, out;
      for (std::size_t i = 0; i < given.size(); ++i)
        in.emplace_back(&interface.inputs[i], given[i]);
      for (std::size_t i = 0; i < filled.size(); ++i) {
        interface.outputs[i].type.header(filled[i].get()) = header;
        out.emplace_back(&interface.outputs[i], filled[i]);
      }
      stage::Outputs outputs(out);
      stage.process(stage::Inputs(header, in), outputs);
    };
    const auto found = share(planes_t{});
    run(*planes, {rgbd}, {found});
    const auto said_pose = share(camera_pose_t{});
    const auto said_key_frame = share(keyframe_t{});
    run(*tracker, {rgbd, found, last_update}, {said_pose, said_key_frame});
    const auto said_update = share(map_update_t{});
    run(*mapper, {said_key_frame}, {said_update});
    last_update = said_update;
    pose = *said_pose;
    key_frame = *said_key_frame;
    map_update = *said_update;
  }
  std::shared_ptr<map_update_t> last_update;
};

TEST(MapStages, ARestartedTrackerGetsTheWholeMapAndGoesOnInIt) {
  ByHand run;
  for (std::size_t i = 0; i < 4; ++i) run.play(i);
  const auto map_id = run.pose.map_id;
  ASSERT_NE(map_id, 0);
  run.tracker = ByHand::make_tracker();
  run.play(4);
  // It has seen that there is a map, and begins none of its own.
  EXPECT_EQ(int{run.pose.state}, int{camera_pose_t::NOT_STARTED});
  EXPECT_EQ(run.pose.tracker_session, 4);
  EXPECT_EQ(run.key_frame.map_id, 0);
  EXPECT_EQ(run.map_update.from_version, 0);
  run.play(5);
  EXPECT_EQ(int{run.pose.state}, int{camera_pose_t::TRACKED}) << run.pose.reason;
  EXPECT_EQ(run.pose.map_id, map_id);
  EXPECT_LT(error_m(run.pose), 0.02);
}

TEST(MapStages, ARestartedMapperBeginsAnewAndSoDoesTheTracker) {
  ByHand run;
  for (std::size_t i = 0; i < 4; ++i) run.play(i);
  const auto old = run.pose.map_id;
  run.mapper = ByHand::make_mapper();
  run.play(4);
  EXPECT_NE(run.map_update.map_id, old);
  EXPECT_EQ(run.map_update.to_version, 0);
  run.play(5);  // begins a map
  EXPECT_EQ(run.key_frame.is_key_frame, 1);
  EXPECT_EQ(run.key_frame.pose_version, 0);
  EXPECT_EQ(run.map_update.to_version, 1);
  run.play(6);
  EXPECT_EQ(int{run.pose.state}, int{camera_pose_t::TRACKED}) << run.pose.reason;
  EXPECT_EQ(run.pose.map_id, run.map_update.map_id);
  EXPECT_NE(run.pose.map_id, old);
}

TEST(MapStages, AMissedUpdateIsInTheNext) {
  ByHand run;
  for (std::size_t i = 0; i < 3; ++i) run.play(i);
  run.last_update = nullptr;
  run.play(3);
  run.last_update = nullptr;
  run.play(4);
  run.play(5);
  EXPECT_EQ(int{run.pose.state}, int{camera_pose_t::TRACKED}) << run.pose.reason;
  EXPECT_EQ(run.pose.map_version, run.map_update.from_version);
}

TEST(MapStages, SettingsThatCannotBeAreRefused) {
  EXPECT_THROW(track_process::make_stage(settings("vocabulary: ''\nfeatures: {features: 5000}")),
               Error);
  EXPECT_THROW(track_process::make_stage(settings("vocabulary: none.blob")), Error);
  EXPECT_THROW(track_process::make_stage(settings("vocabulary: ''\nmap_delay: 0")), Error);
  EXPECT_THROW(map_process::make_stage(settings("vocabulary: none.blob")), Error);
}

TEST(MapStages, ASavedMapIsGoneOnIn) {
  const test::TemporaryFolder folder;
  const std::string file = folder / "room.map";
  std::int64_t points = 0;
  {
    Play first("", "save: " + file + "\n");
    first.play(0, 6);
    points = first.updates.back().point_count;
    EXPECT_FALSE(std::filesystem::exists(file));
  }  // the process stops
  ASSERT_TRUE(std::filesystem::exists(file));

  ByHand run;
  run.tracker = track_process::make_stage(settings("vocabulary: ''\nwait_for_mapper: true"));
  run.mapper = map_process::make_stage(settings("vocabulary: ''\nload: " + file));
  run.play(7);
  EXPECT_EQ(int{run.pose.state}, int{camera_pose_t::NOT_STARTED});
  EXPECT_EQ(run.map_update.point_count, points);
  for (std::size_t i = 8; i < 14; ++i) {
    run.play(i);
    ASSERT_EQ(int{run.pose.state}, int{camera_pose_t::TRACKED}) << run.pose.reason;
    EXPECT_LT(error_m(run.pose), 0.02);
    EXPECT_EQ(run.map_update.refused, "");
  }
  EXPECT_GE(run.map_update.point_count, points);

  test::write_bytes(file, test::read_bytes(file).substr(0, 5000));
  EXPECT_THROW(map_process::make_stage(settings("vocabulary: ''\nload: " + file)), Error);
}

/// Maps with this many key frames, in the file and the earlier ones beside it; -1: no file.
std::vector<int> key_frames_in(const std::string& file) {
  std::vector<int> out;
  for (const char* age : {"", ".1", ".2", ".3", ".4"})
    out.push_back(std::filesystem::exists(file + age)
                      ? static_cast<int>(slam::read_map(file + age).map.key_frames.size())
                      : -1);
  return out;
}

TEST(MapStages, AnotherSessionsMapDoesNotReplaceASavedOne) {
  const test::TemporaryFolder folder;
  const std::string file = folder / "room.map";
  const auto mapper = [&] {
    return map_process::make_stage(settings("vocabulary: ''\nsave_every: 1\nsave: " + file));
  };
  {
    ByHand run;
    run.mapper = mapper();
    for (std::size_t i = 0; i < 8; ++i) run.play(i);
    const int first = run.map_update.key_frame_count;
    EXPECT_GT(first, 1);
    EXPECT_EQ(key_frames_in(file), (std::vector{first, -1, -1, -1, -1}));
    run.tracker = ByHand::make_tracker();
    run.last_update = nullptr;
    run.play(0, 4);  // the camera was started again: another map, of one key frame
    EXPECT_EQ(key_frames_in(file), (std::vector{1, first, -1, -1, -1}));
    run.play(1, 4);
    EXPECT_EQ(key_frames_in(file)[1], first);
  }
  for (int starts = 0; starts < 4; ++starts) {  // so does a process that was started again
    ByHand run;
    run.mapper = mapper();
    run.play(0);
  }
  EXPECT_EQ(key_frames_in(file), (std::vector{1, 1, 1, 1, -1}));
}

TEST(MapStages, ALoadedMapIsGoneOnInByLaterSessionsToo) {
  const test::TemporaryFolder folder;
  const std::string file = folder / "room.map";
  {
    Play first("", "save: " + file + "\n");
    first.play(0, 4);
  }
  const int loaded = key_frames_in(file)[0];
  ByHand run;
  const auto tracker = [] {
    return track_process::make_stage(settings("vocabulary: ''\nwait_for_mapper: true"));
  };
  run.tracker = tracker();
  run.mapper = map_process::make_stage(
      settings("vocabulary: ''\nsave_every: 1\nload: " + file + "\nsave: " + file));
  for (std::size_t i = 3; i < 9; ++i) run.play(i);
  const int grown = run.map_update.key_frame_count;
  ASSERT_GT(grown, loaded);
  EXPECT_EQ(key_frames_in(file), (std::vector{grown, -1, -1, -1, -1}));
  // The camera is started again: what was mapped meanwhile is there still.
  run.tracker = tracker();
  run.last_update = nullptr;
  for (std::size_t i = 7; i < 14; ++i) run.play(i, 4);
  EXPECT_EQ(int{run.pose.state}, int{camera_pose_t::TRACKED}) << run.pose.reason;
  EXPECT_GE(run.map_update.key_frame_count, grown);
  EXPECT_LT(error_m(run.pose), 0.02);
  const auto there = key_frames_in(file);
  EXPECT_GE(there[0], grown);
  EXPECT_EQ(there[1], -1);
}

/// A garment that fills a window of the picture, with a part at its middle.
struct Seen {
  foreground_t foreground{};
  part_detections_t detections{};
  grasps_t grasps{};
  Eigen::Vector3d point_camera;
};
Seen see_garment(const Bytes& frame_bytes) {
  const auto frame = decode<rgbd_frame_t>(frame_bytes);
  const auto images =
      messages::from_message(frame, {.colour = false, .depth = true, .mask = false});
  Seen out;
  foreground::Foreground foreground;
  foreground.mask = cv::Mat::zeros(images.depth.size(), CV_8UC1);
  const int u = images.depth.cols / 2, v = images.depth.rows / 2;
  foreground.mask(cv::Rect(u - 40, v - 30, 81, 61)).setTo(255);
  messages::to_message(foreground, out.foreground);
  detector::Detection detection;
  detection.part = "polo collar";
  detection.probability = 0.6;
  detection.box_view = {u - 10.0, v - 10.0, 20.0, 20.0};
  detection.centre_sensor_px = {u + 0.0, v + 0.0};
  detection.corners_sensor_px.fill(detection.centre_sensor_px);
  rgbd::View view;
  view.sensor = images.camera;
  view.width = images.depth.cols;
  view.height = images.depth.rows;
  messages::to_message(view, {detection}, 1, out.detections);
  out.point_camera = images.camera.unproject(u, v, images.depth_m(u, v));
  detector::Grasp grasp;
  grasp.part = "polo collar";
  grasp.score = 0.5;
  grasp.pixel = detection.centre_sensor_px;
  grasp.point_camera_m = out.point_camera;
  grasp.approach_camera = Eigen::Vector3d::UnitZ();
  messages::to_message({grasp}, std::nullopt, out.grasps);
  out.foreground.header = out.detections.header = out.grasps.header = frame.header;
  return out;
}

TEST(MapStages, GarmentsAreKeptInTheMap) {
  Play run("",
           "garments: true\ndetection_delay: 2\nT_base_camera: [0, 0, 1, 0, 0, 0, 1]\n"
           "garment_map: {views_to_appear: 1}");
  std::vector<map_objects_t> said;
  run.set.observe([&](const std::string& channel, const Bytes& bytes) {
    if (channel == "MAP_OBJECTS") said.push_back(decode<map_objects_t>(bytes));
    if (channel == "CAMERA_POSE") run.poses.push_back(decode<camera_pose_t>(bytes));
    if (channel == "KEYFRAME") run.key_frames.push_back(decode<keyframe_t>(bytes));
  });
  std::vector<Eigen::Vector3d> points_camera;
  for (std::size_t i = 0; i < frames().size(); ++i) {
    const Seen seen = see_garment(frames()[i]);
    points_camera.push_back(seen.point_camera);
    run.set.inject("FOREGROUND", encode(seen.foreground));
    run.set.inject("PART_DETECTIONS", encode(seen.detections));
    run.set.inject("GRASPS", encode(seen.grasps));
    run.set.inject("RGBD_FRAME", frames()[i]);
    run.set.run();
  }
  ASSERT_EQ(said.size(), frames().size());
  EXPECT_EQ(int{said[1].status.code}, int{status_t::NOTHING});
  // The first key frame's garment comes two frames later, where its camera saw it.
  const auto content = messages::from_message(said[2]);
  ASSERT_EQ(content.garments.size(), 1u);
  const auto& garment = content.garments[0];
  EXPECT_TRUE(garment.in_map);
  ASSERT_EQ(garment.parts.size(), 1u);
  EXPECT_EQ(garment.parts[0].part, "polo collar");
  EXPECT_TRUE(garment.parts[0].has_grasp);
  const auto T_world_camera = messages::from_message(run.poses[0].T_world_camera, "test");
  EXPECT_LT((garment.parts[0].position_world - T_world_camera * points_camera[0]).norm(), 0.005);
  // In the robot's base: 1 m behind the camera.
  ASSERT_TRUE(content.T_base_world);
  const auto T_camera_world = messages::from_message(run.poses[2].T_world_camera, "test").inverse();
  const Eigen::Vector3d expected =
      T_camera_world * garment.position_world + Eigen::Vector3d::UnitZ();
  EXPECT_LT(
      (Eigen::Map<const Eigen::Vector3d>(said[2].objects[0].position_base_m) - expected).norm(),
      1e-9);
}

TEST(MapStages, ACameraThatStandsStillFindsGarmentsToo) {
  for (const int look_every : {2, 0}) {
    Play run("", "garments: true\ndetection_delay: 1\nlook_every: " + std::to_string(look_every));
    std::vector<map_objects_t> said;
    run.set.observe([&](const std::string& channel, const Bytes& bytes) {
      if (channel == "MAP_OBJECTS") said.push_back(decode<map_objects_t>(bytes));
      if (channel == "KEYFRAME") run.key_frames.push_back(decode<keyframe_t>(bytes));
    });
    for (int i = 0; i < 14; ++i) {
      auto frame = decode<rgbd_frame_t>(frames()[0]);
      frame.header.seq = i;
      frame.header.utime = 1'000'000 + 33'333 * i;
      const Bytes bytes = encode(frame);
      const Seen seen = see_garment(bytes);
      run.set.inject("FOREGROUND", encode(seen.foreground));
      run.set.inject("PART_DETECTIONS", encode(seen.detections));
      run.set.inject("GRASPS", encode(seen.grasps));
      run.set.inject("RGBD_FRAME", bytes);
      run.set.run();
    }
    int key_frames = 0;
    for (const auto& each : run.key_frames) key_frames += each.is_key_frame;
    EXPECT_LT(key_frames, 5);
    ASSERT_EQ(said.back().object_count, 1);
    EXPECT_EQ(int{said.back().objects[0].in_map}, look_every > 0 ? 1 : 0);
  }
}

TEST(MapStages, ALostDetectionCostsNoKeyFrame) {
  Play run("", "garments: true\ndetection_delay: 2");
  for (std::size_t i = 0; i < 6; ++i) {
    Seen seen = see_garment(frames()[i]);
    seen.foreground.status.code = status_t::FAILED;
    run.set.inject("FOREGROUND", encode(seen.foreground));
    run.set.inject("PART_DETECTIONS", encode(seen.detections));
    run.set.inject("GRASPS", encode(seen.grasps));
    run.set.inject("RGBD_FRAME", frames()[i]);
    run.set.run();
  }
  ASSERT_EQ(run.poses.size(), 6u);
  EXPECT_EQ(int{run.updates[0].status.code}, int{status_t::OK});
  EXPECT_GT(run.updates[0].key_frame_count, 0);
}

TEST(MapStages, AMalformedDetectionFailsTheObjectsAndNotTheMap) {
  Play run("", "garments: true\ndetection_delay: 2\ngarment_map: {views_to_appear: 1}");
  std::vector<map_objects_t> said;
  run.set.observe([&](const std::string& channel, const Bytes& bytes) {
    if (channel == "MAP_OBJECTS") said.push_back(decode<map_objects_t>(bytes));
    if (channel == "MAP_UPDATE") run.updates.push_back(decode<map_update_t>(bytes));
  });
  for (std::size_t i = 0; i < frames().size(); ++i) {
    Seen seen = see_garment(frames()[i]);
    if (i == 0) seen.detections.detections[0].probability = 7.0;
    run.set.inject("FOREGROUND", encode(seen.foreground));
    run.set.inject("PART_DETECTIONS", encode(seen.detections));
    run.set.inject("GRASPS", encode(seen.grasps));
    run.set.inject("RGBD_FRAME", frames()[i]);
    run.set.run();
  }
  ASSERT_EQ(said.size(), frames().size());
  EXPECT_EQ(int{said[2].status.code}, int{status_t::FAILED});
  EXPECT_NE(said[2].status.text.find("PART_DETECTIONS"), std::string::npos) << said[2].status.text;
  EXPECT_EQ(said[2].object_count, 0);
  for (const auto& update : run.updates)
    EXPECT_NE(int{update.status.code}, int{status_t::FAILED}) << update.header.seq;
  // The next key frame's are taken in.
  EXPECT_EQ(int{said.back().status.code}, int{status_t::OK}) << said.back().status.text;
  EXPECT_EQ(said.back().object_count, 1);
}

TEST(MapStages, AnArmsCameraTellsWhereTheBaseIs) {
  EXPECT_THROW(map_process::make_stage(settings("vocabulary: ''\nT_base_camera: [0, 0, 1, 0, 0, "
                                                "0, 1]\ncamera_in_base_delay: 1")),
               Error);
  Play run("", "garments: true\ndetection_delay: 2\ncamera_in_base_delay: 1");
  std::vector<map_objects_t> said;
  run.set.observe([&](const std::string& channel, const Bytes& bytes) {
    if (channel == "MAP_OBJECTS") said.push_back(decode<map_objects_t>(bytes));
    if (channel == "CAMERA_POSE") run.poses.push_back(decode<camera_pose_t>(bytes));
  });
  // The base stands still in the room, so the camera's motion must not be seen in its pose.
  const slam::Rigid3d T_base_room{Eigen::Quaterniond(0.8, 0.0, 0.6, 0.0), {0.5, -1.0, 2.0}};
  for (std::size_t i = 0; i < 10; ++i) {
    camera_in_base_t arm{};
    arm.header = decode<rgbd_frame_t>(frames()[i]).header;
    if (i == 6) arm.status.code = status_t::FAILED;  // the arm did not know
    arm.T_base_camera =
        messages::to_message(T_base_room * test::TexturedRoom::path(0.1 * static_cast<double>(i)));
    if (i == 8) arm.T_base_camera.rotation[0] = 7.0;  // impossible
    run.set.inject("CAMERA_IN_BASE", encode(arm));
    const Seen seen = see_garment(frames()[i]);
    run.set.inject("FOREGROUND", encode(seen.foreground));
    run.set.inject("PART_DETECTIONS", encode(seen.detections));
    run.set.inject("GRASPS", encode(seen.grasps));
    run.set.inject("RGBD_FRAME", frames()[i]);
    run.set.run();
  }
  ASSERT_EQ(said.size(), 10u);
  EXPECT_EQ(int{said[0].has_base}, 0);
  EXPECT_EQ(int{said[7].has_base}, 0);
  EXPECT_EQ(int{said[9].status.code}, int{status_t::FAILED});
  EXPECT_NE(said[9].status.text.find("CAMERA_IN_BASE"), std::string::npos) << said[9].status.text;
  // The world is the first camera's frame.
  const slam::Rigid3d T_base_world = T_base_room * test::TexturedRoom::path(0.0);
  for (const int i : {4, 5, 6, 8}) {
    const auto& each = said[static_cast<std::size_t>(i)];
    ASSERT_EQ(int{each.has_base}, 1) << i;
    const auto T = messages::from_message(each.T_base_world, "test");
    EXPECT_LT((T.translation - T_base_world.translation).norm(), 0.02) << i;
    EXPECT_LT(T.rotation.angularDistance(T_base_world.rotation), 0.01) << i;
  }
}

}  // namespace
}  // namespace weft
