#include "messages/map.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "base/random.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

const rgbd::CameraModel kCamera{640, 480, 525.0, 524.0, 319.5, 239.5};

slam::Rigid3d pose(Random& random) {
  slam::Rigid3d out;
  out.rotation =
      Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
          .normalized();
  out.translation = {random.normal(), random.normal(), random.normal()};
  return out;
}

slam::Feature feature(Random& random) {
  slam::Feature out;
  out.u_px = static_cast<float>(640 * random.uniform());
  out.v_px = static_cast<float>(480 * random.uniform());
  out.depth_m = static_cast<float>(3 * random.uniform());
  out.angle_deg = static_cast<float>(359 * random.uniform());
  out.level = static_cast<int>(random.below(8));
  for (auto& word : out.descriptor) word = random.bits();
  return out;
}

plane::PlaneSegment segment(Random& random) {
  plane::PlaneSegment out;
  out.plane = {Eigen::Vector3d(random.normal(), random.normal(), -2.0).normalized(), -1.5, 0.002,
               5000};
  Eigen::Matrix3d half;
  for (int i = 0; i < 9; ++i) half(i / 3, i % 3) = random.normal();
  out.covariance = half * half.transpose();
  out.covariance = (0.5 * (out.covariance + out.covariance.transpose())).eval();
  out.cells = 12;
  out.points_camera = {{0.1f, 0.2f, 1.5f}, {0.3f, 0.2f, 1.4f}};
  return out;
}

void expect_equal(const slam::Rigid3d& a, const slam::Rigid3d& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
}

void expect_equal(const std::vector<slam::Feature>& a, const std::vector<slam::Feature>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].u_px, b[i].u_px);
    EXPECT_EQ(a[i].v_px, b[i].v_px);
    EXPECT_EQ(a[i].depth_m, b[i].depth_m);
    EXPECT_EQ(a[i].angle_deg, b[i].angle_deg);
    EXPECT_EQ(a[i].level, b[i].level);
    EXPECT_EQ(a[i].descriptor, b[i].descriptor);
  }
}

void expect_equal(const plane::PlaneSegment& a, const plane::PlaneSegment& b) {
  EXPECT_EQ(a.plane.normal, b.plane.normal);
  EXPECT_EQ(a.plane.distance_m, b.plane.distance_m);
  EXPECT_EQ(a.plane.rms_m, b.plane.rms_m);
  EXPECT_EQ(a.plane.support, b.plane.support);
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.cells, b.cells);
  EXPECT_EQ(a.points_camera, b.points_camera);
}

slam::NewKeyFrame key_frame() {
  Random random(3);
  slam::NewKeyFrame out;
  out.input.frame = 17;
  out.input.utime = 1'234'567;
  out.input.camera = kCamera;
  for (int i = 0; i < 40; ++i) out.input.features.push_back(feature(random));
  out.input.planes = {segment(random), segment(random)};
  out.T_camera_world = pose(random);
  out.map_version = 9;
  out.reference = 4;
  for (int i = 0; i < 40; ++i) out.points.push_back(i % 3 == 0 ? slam::kNoId : 100 + i);
  out.planes = {slam::kNoId, 2};
  out.new_plane = true;
  out.by_planes = true;
  out.seen_points = {{101, 3, 2}, {102, 1, 0}};
  out.seen_planes = {{2, 5, 5}};
  return out;
}

keyframe_t key_frame_message() {
  keyframe_t message{};
  const auto sent = key_frame();
  to_message(&sent, 5, {77, 9}, message);
  message.header.seq = sent.input.frame;
  message.header.utime = sent.input.utime;
  return message;
}

TEST(KeyFrameMessage, EveryNumberComesBack) {
  const auto sent = key_frame();
  const auto content = from_message(key_frame_message());
  EXPECT_EQ(content.tracker_session, 5);
  EXPECT_EQ(content.map.map_id, 77);
  EXPECT_EQ(content.map.version, 9);
  ASSERT_TRUE(content.key_frame);
  const auto& got = *content.key_frame;
  EXPECT_EQ(got.input.frame, sent.input.frame);
  EXPECT_EQ(got.input.utime, sent.input.utime);
  EXPECT_EQ(got.input.camera, sent.input.camera);
  expect_equal(got.input.features, sent.input.features);
  ASSERT_EQ(got.input.planes.size(), 2u);
  expect_equal(got.input.planes[1], sent.input.planes[1]);
  expect_equal(got.T_camera_world, sent.T_camera_world);
  EXPECT_EQ(got.map_version, sent.map_version);
  EXPECT_EQ(got.reference, sent.reference);
  EXPECT_EQ(got.points, sent.points);
  EXPECT_EQ(got.planes, sent.planes);
  EXPECT_TRUE(got.new_plane);
  EXPECT_TRUE(got.by_planes);
  ASSERT_EQ(got.seen_points.size(), 2u);
  EXPECT_EQ(got.seen_points[1].id, 102);
  EXPECT_EQ(got.seen_points[0].visible, 3);
  EXPECT_EQ(got.seen_points[0].found, 2);
  ASSERT_EQ(got.seen_planes.size(), 1u);
}

TEST(KeyFrameMessage, MaySayNotOne) {
  keyframe_t message{};
  to_message(nullptr, 5, {77, 9}, message);
  const auto content = from_message(message);
  EXPECT_FALSE(content.key_frame);
  EXPECT_EQ(content.map.map_id, 77);
  EXPECT_LT(message.getEncodedSize(), 500);
}

TEST(KeyFrameMessage, AThousandFeaturesFitAMessage) {
  Random random(1);
  auto large = key_frame();
  large.input.features.clear();
  for (int i = 0; i < 2000; ++i) large.input.features.push_back(feature(random));
  large.points.assign(2000, 1'000'000);
  large.input.planes.assign(20, segment(random));
  for (auto& each : large.input.planes) each.points_camera.assign(40, Eigen::Vector3f::Ones());
  large.planes.assign(20, 1);
  keyframe_t message{};
  to_message(&large, 0, {}, message);
  EXPECT_LT(static_cast<std::size_t>(message.getEncodedSize()), stage::kMaxMessageBytes);
}

TEST(KeyFrameMessage, ImpossibleContentIsRefused) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::function<void(keyframe_t&)> faults[] = {
      [](keyframe_t& m) { m.map_version = -1; },
      [](keyframe_t& m) { m.camera_model.height = 0; },
      [](keyframe_t& m) { m.T_camera_world.rotation[0] += 0.5; },
      [](keyframe_t& m) {
        m.T_camera_world.translation[2] = std::numeric_limits<double>::infinity();
      },
      [](keyframe_t& m) { m.pose_version = -3; },
      [](keyframe_t& m) { m.reference = -2; },
      [](keyframe_t& m) { m.features.descriptors.pop_back(); },
      [&](keyframe_t& m) { m.features.u_px[3] = nan; },
      [&](keyframe_t& m) { m.features.depth_m[3] = -1.0f; },
      [&](keyframe_t& m) { m.features.angle_deg[3] = 400.0f; },
      [&](keyframe_t& m) { m.features.level[3] = 100; },
      [](keyframe_t& m) { m.points.pop_back(); },
      [](keyframe_t& m) { m.points[0] = -7; },
      [](keyframe_t& m) { m.planes[0].plane.normal[2] = 3.0; },
      [](keyframe_t& m) { m.plane_ids[0] = -7; },
      [](keyframe_t& m) { m.seen_points.ids[0] = -1; },
      [](keyframe_t& m) { m.seen_planes.found[0] = -1; },
  };
  int number = 0;
  for (const auto& fault : faults) {
    auto message = key_frame_message();
    fault(message);
    EXPECT_THROW(from_message(message), stage::InvalidInput) << "fault " << number;
    ++number;
  }
}

TEST(CameraPoseMessage, EveryNumberComesBack) {
  Random random(8);
  slam::TrackedFrame sent;
  sent.state = slam::TrackingState::kTracked;
  sent.reason = "found again";
  sent.T_camera_world = pose(random);
  sent.covariance = Eigen::Matrix<double, 6, 6>::Identity() * 0.25;
  sent.covariance(0, 4) = sent.covariance(4, 0) = 0.1;
  sent.map_version = 12;
  sent.reference = 3;
  sent.T_camera_reference = pose(random);
  sent.points = 210;
  sent.planes = 3;
  camera_pose_t message{};
  to_message(sent, 4, 99, message);
  message.header.seq = 6;
  message.header.utime = 700;
  const auto content = from_message(message);
  EXPECT_EQ(content.tracker_session, 4);
  EXPECT_EQ(content.map_id, 99);
  EXPECT_FALSE(content.key_frame);
  const auto& got = content.tracked;
  EXPECT_EQ(got.frame, 6);
  EXPECT_EQ(got.utime, 700);
  EXPECT_EQ(got.state, sent.state);
  EXPECT_EQ(got.reason, sent.reason);
  EXPECT_LT((got.T_camera_world.translation - sent.T_camera_world.translation).norm(), 1e-14);
  EXPECT_LT(got.T_camera_world.rotation.angularDistance(sent.T_camera_world.rotation), 1e-7);
  // Sent as the camera in the world.
  EXPECT_NEAR(message.T_world_camera.translation[0], sent.T_camera_world.inverse().translation.x(),
              1e-15);
  EXPECT_EQ(got.covariance, sent.covariance);
  EXPECT_EQ(got.map_version, 12);
  EXPECT_EQ(got.reference, 3);
  expect_equal(got.T_camera_reference, sent.T_camera_reference);
  EXPECT_EQ(got.points, 210);
  EXPECT_EQ(got.planes, 3);

  const std::function<void(camera_pose_t&)> faults[] = {
      [](camera_pose_t& m) { m.state = 9; },
      [](camera_pose_t& m) { m.map_version = -1; },
      [](camera_pose_t& m) { m.T_world_camera.rotation[1] = 3; },
      [](camera_pose_t& m) { m.T_camera_reference.rotation[1] = 3; },
      [](camera_pose_t& m) { m.covariance[7] = -1; },
      [](camera_pose_t& m) { m.covariance[1] = std::numeric_limits<double>::quiet_NaN(); },
      [](camera_pose_t& m) { m.reference = -2; },
      [](camera_pose_t& m) { m.planes = -1; },
  };
  for (const auto& fault : faults) {
    auto bad = message;
    fault(bad);
    EXPECT_THROW(from_message(bad), stage::InvalidInput);
  }
}

/// A map of 2 key frames, 3 points, a plane.
slam::Map small_map() {
  Random random(5);
  slam::Map map;
  map.version = 6;
  for (slam::Id id = 0; id < 2; ++id) {
    slam::KeyFrame& k = map.key_frames[id];
    k.id = id;
    k.frame = 10 * id;
    k.utime = 1000 * id;
    k.camera = kCamera;
    k.T_camera_world = pose(random);
    for (int i = 0; i < 5; ++i) k.features.push_back(feature(random));
    k.points.assign(5, slam::kNoId);
    k.planes = {{segment(random), 0}};
    k.keep = id == 1;
    k.parent = id - 1;
    k.loop_partners = id == 1 ? std::vector<slam::Id>{0} : std::vector<slam::Id>{};
  }
  for (slam::Id id = 0; id < 3; ++id) {
    slam::MapPoint& p = map.points[id];
    p.id = id;
    p.position_world = {random.normal(), random.normal(), random.normal()};
    p.viewing_direction = Eigen::Vector3d(random.normal(), 1, 1).normalized();
    p.min_distance_m = 0.5;
    p.max_distance_m = 4.0;
    for (auto& word : p.descriptor) word = random.bits();
    p.observations = {{0, static_cast<int>(id)}, {1, static_cast<int>(id) + 2}};
    p.first_key_frame = 0;
    p.visible = 7;
    p.found = 5;
    for (const auto& o : p.observations)
      map.key_frames[o.key_frame].points[static_cast<std::size_t>(o.index)] = id;
  }
  slam::MapPlane& plane = map.planes[0];
  plane.id = 0;
  plane.normal_world = Eigen::Vector3d(0, 0.6, 0.8);
  plane.distance_m = -1.25;
  plane.covariance = Eigen::Vector3d(1e-4, 2e-4, 3e-4).asDiagonal();
  plane.cloud_world = {{1, 2, 3}, {4, 5, 6}};
  plane.observations = {{0, 0}, {1, 0}};
  plane.sightings = 9;
  plane.confirmed = true;
  return map;
}

map_update_t update_message() {
  const slam::Map map = small_map();
  map_update_t message{};
  to_message(slam::whole_map(map, 12), 55, map, message);
  return message;
}

TEST(MapUpdateMessage, TheCopyIsTheMap) {
  const slam::Map map = small_map();
  const auto message = update_message();
  EXPECT_EQ(message.map_id, 55);
  EXPECT_EQ(message.key_frame_count, 2);
  EXPECT_EQ(message.point_count, 3);
  EXPECT_EQ(message.plane_count, 1);
  const auto update = from_message(message);
  EXPECT_EQ(update.frame, 12);
  slam::Map copy;
  slam::apply(update, copy);
  EXPECT_EQ(copy.version, map.version);
  ASSERT_EQ(copy.key_frames.size(), 2u);
  for (const auto& [id, k] : map.key_frames) {
    const auto& c = copy.key_frames.at(id);
    EXPECT_EQ(c.id, k.id);
    EXPECT_EQ(c.frame, k.frame);
    EXPECT_EQ(c.utime, k.utime);
    EXPECT_EQ(c.camera, k.camera);
    expect_equal(c.T_camera_world, k.T_camera_world);
    expect_equal(c.features, k.features);
    EXPECT_EQ(c.points, k.points);
    ASSERT_EQ(c.planes.size(), 1u);
    expect_equal(c.planes[0].segment, k.planes[0].segment);
    EXPECT_EQ(c.planes[0].plane, 0);
    EXPECT_EQ(c.keep, k.keep);
    EXPECT_EQ(c.parent, k.parent);
    EXPECT_EQ(c.loop_partners, k.loop_partners);
  }
  for (const auto& [id, p] : map.points) {
    const auto& c = copy.points.at(id);
    EXPECT_EQ(c.position_world, p.position_world);
    EXPECT_EQ(c.viewing_direction, p.viewing_direction);
    EXPECT_EQ(c.min_distance_m, p.min_distance_m);
    EXPECT_EQ(c.max_distance_m, p.max_distance_m);
    EXPECT_EQ(c.descriptor, p.descriptor);
    EXPECT_EQ(c.observations, p.observations);
    EXPECT_EQ(c.first_key_frame, p.first_key_frame);
    EXPECT_EQ(c.visible, p.visible);
    EXPECT_EQ(c.found, p.found);
  }
  const auto &plane = map.planes.at(0), &c = copy.planes.at(0);
  EXPECT_EQ(c.normal_world, plane.normal_world);
  EXPECT_EQ(c.distance_m, plane.distance_m);
  EXPECT_EQ(c.covariance, plane.covariance);
  EXPECT_EQ(c.cloud_world, plane.cloud_world);
  EXPECT_EQ(c.observations, plane.observations);
  EXPECT_EQ(c.sightings, plane.sightings);
  EXPECT_EQ(c.confirmed, plane.confirmed);
}

TEST(MapUpdateMessage, ChangesAndRemovalsComeBack) {
  Random random(2);
  slam::MapUpdate sent;
  sent.from_version = 3;
  sent.to_version = 4;
  sent.key_frames = {{1, pose(random), true, 0, {0, 2}}};
  sent.removed_key_frames = {5};
  sent.removed_points = {6, 7};
  sent.removed_planes = {8};
  map_update_t message{};
  to_message(sent, 1, {}, message);
  const auto got = from_message(message);
  EXPECT_EQ(got.from_version, 3);
  EXPECT_EQ(got.to_version, 4);
  ASSERT_EQ(got.key_frames.size(), 1u);
  EXPECT_EQ(got.key_frames[0].id, 1);
  expect_equal(got.key_frames[0].T_camera_world, sent.key_frames[0].T_camera_world);
  EXPECT_TRUE(got.key_frames[0].keep);
  EXPECT_EQ(got.key_frames[0].parent, 0);
  EXPECT_EQ(got.key_frames[0].loop_partners, sent.key_frames[0].loop_partners);
  EXPECT_EQ(got.removed_key_frames, sent.removed_key_frames);
  EXPECT_EQ(got.removed_points, sent.removed_points);
  EXPECT_EQ(got.removed_planes, sent.removed_planes);
}

TEST(MapUpdateMessage, ImpossibleContentIsRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::function<void(map_content_t&)> content_faults[] = {
      [](map_content_t& c) { c.new_key_frames[0].id = -1; },
      [](map_content_t& c) { c.new_key_frames[0].parent = -2; },
      [](map_content_t& c) { c.new_key_frames[0].camera_model.fy = -1; },
      [](map_content_t& c) { c.new_key_frames[1].T_camera_world.rotation[3] = 4; },
      [](map_content_t& c) { c.new_key_frames[1].loop_partners[0] = -1; },
      [](map_content_t& c) { c.new_key_frames[1].features.level[0] = -1; },
      [](map_content_t& c) { c.new_key_frames[1].planes[0].cells = -1; },
      [&](map_content_t& c) { c.points[1].position_world_m[1] = nan; },
      [&](map_content_t& c) { c.points[1].viewing_direction[1] = nan; },
      [](map_content_t& c) { c.points[1].min_distance_m = 9; },
      [](map_content_t& c) { c.points[1].found = -9; },
      [](map_content_t& c) { c.points[1].observations[0].index = -1; },
      [](map_content_t& c) { c.points[1].observations[0].key_frame = -1; },
      [](map_content_t& c) { c.points[1].first_key_frame = -2; },
      [](map_content_t& c) { c.planes[0].normal_world[0] = 1; },
      [&](map_content_t& c) { c.planes[0].distance_m = nan; },
      [](map_content_t& c) { c.planes[0].sightings = -1; },
      [](map_content_t& c) { c.planes[0].covariance[5] = -1; },
  };
  int number = 0;
  for (const auto& fault : content_faults) {
    auto content = content_of(slam::whole_map(small_map(), 12));
    fault(content);
    slam::MapUpdate update;
    EXPECT_THROW(from_message(content, update, "test"), stage::InvalidInput) << "fault " << number;
    ++number;
  }
  const std::function<void(map_update_t&)> faults[] = {
      [](map_update_t& m) { m.part_count = 2; },    [](map_update_t& m) { m.from_version = 9; },
      [](map_update_t& m) { m.to_version = -1; },   [](map_update_t& m) { m.data.pop_back(); },
      [](map_update_t& m) { m.data.push_back(0); }, [](map_update_t& m) { m.data.clear(); },
      [](map_update_t& m) { m.data[9] = 0xff; },
  };
  for (const auto& fault : faults) {
    auto message = update_message();
    fault(message);
    EXPECT_THROW(from_message(message), stage::InvalidInput);
  }
}

}  // namespace
}  // namespace weft::messages
