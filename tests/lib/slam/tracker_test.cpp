#include "slam/tracker.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <span>

#include "base/error.hpp"
#include "mapping_world.hpp"
#include "slam/mapper.hpp"

namespace weft::slam {
namespace {

using test::MappingWorld;
using test::SeenFrame;
using test::standing_at;

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kRight_m = 0.03, kRight_rad = 1.0 * kDegree;

std::shared_ptr<const BinaryVocabulary> vocabulary_of(const MappingWorld& world) {
  std::vector<std::vector<Descriptor>> pictures;
  for (std::size_t i = 0; i < world.landmarks.size(); ++i) {
    if (i % 50 == 0) pictures.emplace_back();
    pictures.back().push_back(world.landmarks[i].descriptor);
  }
  return std::make_shared<const BinaryVocabulary>(
      BinaryVocabulary::train(pictures, {.branching = 8, .levels = 3}));
}

/// A tracker and the mapper that answers it a frame later, as in lock-step.
class Journey {
 public:
  Journey(MappingWorld& world, std::shared_ptr<const BinaryVocabulary> vocabulary = nullptr,
          const TrackerOptions& options = {})
      : world_(world), tracker_(options, vocabulary), mapper_({}, vocabulary) {}

  SeenFrame see(const Rigid3d& T_camera_world, double after_s = 1.0 / 30.0) {
    utime_ += static_cast<std::int64_t>(after_s * 1e6);
    return world_.see(++frame_, utime_, T_camera_world);
  }
  TrackedFrame take(const SeenFrame& seen) {
    if (update_) tracker_.update(*update_);
    update_.reset();
    auto tracked = tracker_.track(seen.input);
    if (tracked.key_frame) update_ = mapper_.add(*tracked.key_frame);
    if (!started_ && tracked.state == TrackingState::kTracked) T_first_ = seen.T_camera_world;
    started_ = started_ || tracked.state == TrackingState::kTracked;
    truth_ = seen.T_camera_world * T_first_.inverse();
    return tracked;
  }
  TrackedFrame step(const Rigid3d& T_camera_world, double after_s = 1.0 / 30.0) {
    return take(see(T_camera_world, after_s));
  }
  /// Of the last frame taken: the pose is where the camera was.
  bool right(const TrackedFrame& tracked) const {
    const Vector6d miss = error(tracked);
    return tracked.state == TrackingState::kTracked && miss.head<3>().norm() < kRight_rad &&
           miss.tail<3>().norm() < kRight_m;
  }
  Vector6d error(const TrackedFrame& tracked) const {
    return minus(tracked.T_camera_world, truth_);
  }
  Tracker& tracker() { return tracker_; }
  Mapper& mapper() { return mapper_; }

 private:
  MappingWorld& world_;
  Tracker tracker_;
  Mapper mapper_;
  std::optional<MapUpdate> update_;
  std::int64_t frame_ = -1, utime_ = 0;
  bool started_ = false;
  Rigid3d T_first_, truth_;
};

MappingWorld room(int seed) {
  MappingWorld world(seed);
  world.features = 5000;
  world.add_room({0, 0, 0}, 5.0, 2.6, 1200);
  return world;
}
Rigid3d along(int step) {  // 1.5 cm and half a degree a frame
  return standing_at({0.015 * step, 0.0, 0.3 * std::sin(0.05 * step)}, 0.5 * kDegree * step);
}

TEST(Tracker, KnowsWhereItIsAndHowWell) {
  MappingWorld world = room(1);
  TrackerOptions options;
  options.noise.sigma_px = world.sigma_px;
  options.noise.inverse_depth_per_m = world.inverse_depth_per_m;
  Journey run(world, nullptr, options);
  double chi_squared = 0.0;
  int key_frames = 0;
  for (int i = 0; i < 80; ++i) {
    const auto tracked = run.step(along(i));
    ASSERT_TRUE(run.right(tracked)) << i << ": " << tracked.reason;
    key_frames += tracked.key_frame ? 1 : 0;
    if (i == 0) continue;
    const Vector6d miss = run.error(tracked);
    chi_squared += miss.dot(tracked.covariance.ldlt().solve(miss));
    EXPECT_GT(tracked.points, 50);
    EXPECT_GT(tracked.planes, 0);
  }
  EXPECT_GT(key_frames, 2);
  EXPECT_LT(key_frames, 40);
  // Six degrees of freedom, and what the map itself is off by besides.
  EXPECT_GT(chi_squared / 79, 2.0);
  EXPECT_LT(chi_squared / 79, 60.0);
}

TEST(Tracker, TakesFramesFarApart) {
  MappingWorld world = room(2);
  Journey run(world);
  for (int i = 0; i < 20; ++i) {  // 15 cm and 7 degrees a frame
    const auto tracked =
        run.step(standing_at({0.15 * (i % 5), 0.0, 0.02 * i}, 7.0 * kDegree * i), 0.67);
    ASSERT_TRUE(run.right(tracked)) << i << ": " << tracked.reason;
  }
}

TEST(Tracker, StartsWithThreePlanesAndFiftyPoints) {
  MappingWorld world(3);
  world.add_room({0, 0, 0}, 4.0, 2.6, 60);
  world.features = 60;
  const Rigid3d corner = standing_at({-0.5, 0.6, -0.5}, 45.0 * kDegree);
  Journey run(world);
  const auto first = run.step(corner);
  ASSERT_EQ(first.state, TrackingState::kTracked) << first.reason;
  ASSERT_TRUE(first.key_frame);
  EXPECT_TRUE(first.key_frame->by_planes);
  EXPECT_GE(first.planes, 3);
  EXPECT_TRUE(run.right(run.step(corner)));

  TrackerOptions points_alone;
  points_alone.use_planes = false;
  Journey without(world, nullptr, points_alone);
  const auto refused = without.step(corner);
  EXPECT_EQ(refused.state, TrackingState::kNotStarted);
  EXPECT_NE(refused.reason.find("a map starts with more than 500 points"), std::string::npos);
}

TEST(Tracker, ACoveredLensIsLostAndFoundAgain) {
  for (const bool vocabulary : {false, true}) {
    MappingWorld world = room(4);
    Journey run(world, vocabulary ? vocabulary_of(world) : nullptr);
    int i = 0;
    for (; i < 30; ++i) ASSERT_TRUE(run.right(run.step(along(i))));
    for (; i < 50; ++i) {
      SeenFrame covered = run.see(along(i));
      covered.input.features.clear();
      covered.input.planes.clear();
      const auto tracked = run.take(covered);
      ASSERT_EQ(tracked.state, TrackingState::kLost);
      EXPECT_EQ(tracked.reason, "0 features and 0 planes match nothing that is known");
      EXPECT_FALSE(tracked.key_frame);
    }
    const auto again = run.step(along(i));
    EXPECT_TRUE(run.right(again)) << again.reason;
    EXPECT_NE(again.reason.find("found"), std::string::npos) << again.reason;
  }
}

TEST(Tracker, AJumpToAnOldPlaceIsRecognised) {
  MappingWorld world = room(5);
  Journey run(world, vocabulary_of(world));
  const auto round_about = [](int step) {
    const double yaw = 2.0 * kDegree * step;
    return standing_at({-0.8 * std::sin(yaw), 0.0, -0.8 * std::cos(yaw)}, yaw);
  };
  for (int i = 0; i < 90; ++i) ASSERT_TRUE(run.right(run.step(round_about(i)))) << i;
  const auto back = run.step(round_about(12));
  EXPECT_TRUE(run.right(back)) << back.reason;
  EXPECT_NE(back.reason.find("by its looks"), std::string::npos) << back.reason;
  EXPECT_TRUE(run.right(run.step(round_about(13))));
}

TEST(Tracker, AJumpToAnUnknownPlaceIsLostNotGuessed) {
  MappingWorld world = room(6);
  world.add_room({20, 0, 0}, 5.0, 2.6, 1200);
  Journey run(world, vocabulary_of(world));
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(run.right(run.step(along(i))));
  for (int i = 0; i < 10; ++i) {
    const auto tracked = run.step(standing_at({20, 0, 0}, 0.4 + 0.01 * i));
    EXPECT_EQ(tracked.state, TrackingState::kLost) << i;
    EXPECT_FALSE(tracked.reason.empty());
  }
  EXPECT_TRUE(run.right(run.step(along(31))));
}

TEST(Tracker, AHandBeforeAThirdOfThePictureDoesNotTakeTheCameraAlong) {
  MappingWorld world = room(7);
  std::vector<Descriptor> skin;
  for (int k = 0; k < 100; ++k) skin.push_back(test::any_descriptor(world.random()));
  Journey run(world);
  for (int i = 0; i < 60; ++i) {
    SeenFrame seen = run.see(along(i));
    if (i >= 10) {
      // What lies behind is hidden; the hand's own texture, less than the room's, moves 12 px a
      // frame: 0.3 m/s.
      auto& features = seen.input.features;
      std::erase_if(features, [](const Feature& f) { return f.u_px > 213 && f.u_px < 427; });
      for (int k = 0; k < 100; ++k) {
        Feature on_hand;
        on_hand.u_px = static_cast<float>(213 + (k * 29 + 12 * i) % 214);
        on_hand.v_px = static_cast<float>((k * 67) % 480);
        on_hand.depth_m = 0.5f;
        on_hand.level = k % 4;
        on_hand.descriptor = skin[static_cast<std::size_t>(k)];
        features.push_back(on_hand);
      }
    }
    const auto tracked = run.take(seen);
    ASSERT_TRUE(run.right(tracked)) << i << ": " << tracked.reason;
  }
}

TEST(Tracker, TurningOnTheSpotIsTrackedAllRound) {
  MappingWorld world = room(8);
  Journey run(world);
  for (int i = 0; i < 180; ++i) {
    const auto tracked = run.step(standing_at({0.4, 0, -0.2}, 2.0 * kDegree * i));
    ASSERT_TRUE(run.right(tracked)) << i << ": " << tracked.reason;
  }
}

TEST(Tracker, BeforeABareWallItIsLost) {
  MappingWorld world = room(9);
  Journey run(world);
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(run.right(run.step(along(i))));
  for (int i = 30; i < 40; ++i) {
    SeenFrame bare = run.see(along(i));
    bare.input.features.clear();
    bare.input.planes.resize(1);
    const auto tracked = run.take(bare);
    ASSERT_EQ(tracked.state, TrackingState::kLost);
    EXPECT_FALSE(tracked.reason.empty());
  }
  EXPECT_TRUE(run.right(run.step(along(40))));
}

TEST(Tracker, LookalikesDoNotOutvotePlanes) {
  // A second set of landmarks, the same but shifted along the wall, is what a row of doors is.
  MappingWorld world = room(10);
  const std::size_t own = world.landmarks.size();
  for (std::size_t i = 0; i < own; i += 2) {
    auto twin = world.landmarks[i];
    twin.position_world += 0.3 * Eigen::Vector3d(twin.normal_world.z(), 0, -twin.normal_world.x());
    world.landmarks.push_back(twin);
  }
  Journey run(world);
  int tracked_frames = 0;
  for (int i = 0; i < 15; ++i) {
    const auto tracked = run.step(standing_at({0.12 * (i % 4), 0.0, 0.0}, 6.0 * kDegree * i), 0.67);
    if (tracked.state != TrackingState::kTracked) continue;
    ++tracked_frames;
    EXPECT_TRUE(run.right(tracked)) << i << ": " << run.error(tracked).transpose();
  }
  EXPECT_GE(tracked_frames, 12);
}

TEST(Tracker, ARestartedMapperBeginsAnew) {
  MappingWorld world = room(11);
  Journey run(world);
  for (int i = 0; i < 20; ++i) run.step(along(i));
  run.tracker().update(MapUpdate{});
  const auto tracked = run.tracker().track(run.see(along(20)).input);
  EXPECT_EQ(tracked.reason, "a new map begins");
  EXPECT_EQ(tracked.map_version, 0);
}

TEST(Tracker, SaysTheSameEachTime) {
  std::vector<TrackedFrame> before;
  for (int round = 0; round < 2; ++round) {
    MappingWorld world = room(12);
    Journey run(world, vocabulary_of(world));
    for (int i = 0; i < 40; ++i) {
      const auto tracked = run.step(along(i));
      if (round == 0) {
        before.push_back(tracked);
        continue;
      }
      const auto& first = before[static_cast<std::size_t>(i)];
      EXPECT_EQ(tracked.T_camera_world.rotation.coeffs(), first.T_camera_world.rotation.coeffs());
      EXPECT_EQ(tracked.T_camera_world.translation, first.T_camera_world.translation);
      EXPECT_EQ(tracked.covariance, first.covariance);
    }
  }
}

TEST(Tracker, RefusesFramesThatCannotBe) {
  MappingWorld world = room(13);
  Journey run(world);
  auto seen = run.see(along(0));
  run.take(seen);
  EXPECT_THROW(run.tracker().track(seen.input), Error);  // not after the last one
  auto wrong = run.see(along(1)).input;
  wrong.features[0].u_px = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(run.tracker().track(wrong), Error);
  wrong = run.see(along(1)).input;
  wrong.features[0].level = 8;
  EXPECT_THROW(run.tracker().track(wrong), Error);
  wrong = run.see(along(1)).input;
  wrong.planes[0].plane.normal.setZero();
  EXPECT_THROW(run.tracker().track(wrong), Error);
  EXPECT_TRUE(run.right(run.step(along(1))));
}

}  // namespace
}  // namespace weft::slam
