#include "slam/camera_path.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::slam {
namespace {

Rigid3d random_pose(Random& random) {
  const auto u = [&] { return random.uniform(-1.0, 1.0); };
  return {Eigen::Quaterniond(u(), u(), u(), u()).normalized(), {u(), u(), u()}};
}

/// A chain of key frames, each the child of the one before.
Map chain(Random& random, int count) {
  Map map;
  map.version = 1;
  for (Id id = 0; id < count; ++id) {
    KeyFrame& k = map.key_frames[id];
    k.id = id;
    k.parent = id - 1;  // of the first: kNoId
    k.T_camera_world = random_pose(random);
  }
  return map;
}

TrackedFrame tracked(std::int64_t frame, const Rigid3d& T_camera_world, Id reference) {
  TrackedFrame out;
  out.frame = frame;
  out.utime = 1000 * frame;
  out.state = TrackingState::kTracked;
  out.T_camera_world = T_camera_world;
  out.reference = reference;
  return out;
}

void expect_same(const Rigid3d& a, const Rigid3d& b) {
  EXPECT_LT((a.translation - b.translation).norm(), 1e-12);
  EXPECT_LT(a.rotation.angularDistance(b.rotation), 1e-7);
}

TEST(AnchoredPose, FollowsItsKeyFrameAsARigidBody) {
  Random random(1);
  Map map = chain(random, 3);
  const Rigid3d T_camera_world = random_pose(random);
  const AnchoredPose pose = AnchoredPose::at(T_camera_world, map, 1);
  expect_same(pose.T_camera_world(map), T_camera_world);
  // The world moves under the key frame: what the camera saw from beside it, it sees from there.
  const Rigid3d T_world_moved = random_pose(random);
  map.key_frames[1].T_camera_world = map.key_frames[1].T_camera_world * T_world_moved;
  expect_same(pose.T_camera_world(map), T_camera_world * T_world_moved);
}

TEST(AnchoredPose, IsHeldByTheWorldWhereItsKeyFrameIsNotThere) {
  Random random(2);
  const Map map = chain(random, 2);
  const Rigid3d T_camera_world = random_pose(random);
  const AnchoredPose pose = AnchoredPose::at(T_camera_world, map, 7);
  EXPECT_EQ(pose.reference, kNoId);
  expect_same(pose.T_camera_world(Map{}), T_camera_world);
}

TEST(AnchoredPose, NamesTheKeyFrameThatIsNotInTheMap) {
  Random random(3);
  const AnchoredPose pose = AnchoredPose::at(random_pose(random), chain(random, 3), 2);
  try {
    pose.T_camera_world(chain(random, 2));
    FAIL() << "nothing thrown";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("key frame 2"), std::string::npos) << e.what();
  }
}

TEST(AnchoredPose, GoesToTheNearestAncestorThatStays) {
  Random random(4);
  const Map map = chain(random, 4);
  const Rigid3d T_camera_world = random_pose(random);
  MapUpdate update;
  update.from_version = 1;
  for (const auto& [removed, heir] : std::vector<std::pair<std::vector<Id>, Id>>{
           {{}, 3}, {{1}, 3}, {{3}, 2}, {{3, 2}, 1}, {{3, 1}, 2}, {{0, 1, 2, 3}, kNoId}}) {
    update.removed_key_frames = removed;
    AnchoredPose pose = AnchoredPose::at(T_camera_world, map, 3);
    pose.follow(update, map);
    EXPECT_EQ(pose.reference, heir);
    Map after = map;
    for (const Id id : removed) after.key_frames.erase(id);
    expect_same(pose.T_camera_world(after), T_camera_world);
  }
}

TEST(AnchoredPose, LosesKeyFramesThatAWholeMapHasNot) {
  Random random(5);
  const Map map = chain(random, 3);
  Map other = map;
  other.key_frames.erase(2);
  AnchoredPose pose = AnchoredPose::at(random_pose(random), map, 2);
  pose.follow(whole_map(other, 9), map);
  EXPECT_EQ(pose.reference, 1);
}

TEST(AnchoredPose, EndsWhereParentsGoRoundInACircle) {
  Random random(6);
  Map map = chain(random, 3);
  map.key_frames[0].parent = 2;  // a faulty map
  MapUpdate update;
  update.from_version = 1;
  update.removed_key_frames = {0, 1, 2};
  AnchoredPose pose = AnchoredPose::at(random_pose(random), map, 2);
  pose.follow(update, map);
  EXPECT_EQ(pose.reference, kNoId);
}

TEST(CameraPath, IsCorrectedWithTheMapAndKeepsWhatWasSaidLive) {
  Random random(7);
  Map map = chain(random, 2);
  CameraPath path;
  std::vector<Rigid3d> said;
  for (std::int64_t frame = 0; frame < 6; ++frame) {
    said.push_back(random_pose(random));
    path.add(tracked(frame, said.back(), frame % 2), map);
  }
  TrackedFrame lost = tracked(6, random_pose(random), 0);
  lost.state = TrackingState::kLost;
  path.add(lost, map);

  const Rigid3d T_world_moved = random_pose(random);
  MapUpdate update;
  update.from_version = 1;
  update.removed_key_frames = {1};
  path.follow(update, map);
  map.key_frames.erase(1);
  map.key_frames[0].T_camera_world = map.key_frames[0].T_camera_world * T_world_moved;

  const auto poses = path.poses(map);
  ASSERT_EQ(poses.size(), 6U) << "a lost frame has no pose";
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(poses[i].frame, static_cast<std::int64_t>(i));
    EXPECT_EQ(poses[i].utime, 1000 * static_cast<std::int64_t>(i));
    expect_same(poses[i].T_camera_world, said[i] * T_world_moved);
    expect_same(path.live()[i].T_camera_world, said[i]);
  }
}

}  // namespace
}  // namespace weft::slam
