#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "mapping_world.hpp"

namespace weft::slam {
namespace {

/// What a map holds after each turn of a camera that goes round and round in a room. A key frame
/// comes every ten frames, 40 a turn: 400 frames.
struct Turn {
  std::size_t key_frames = 0, points = 0, planes = 0;
  std::size_t bytes = 0;           // of the map as a file
  std::size_t changed_points = 0;  // in the largest update of the turn
  double worst_m = 0.0;            // largest error of a key frame's place
};

std::vector<Turn> go_round(int turns) {
  test::MappingWorld world(41);
  world.add_room({0, 0, 0}, 4.0, 2.6, 250);
  world.features = 250;
  std::vector<std::vector<Descriptor>> pictures;
  for (std::size_t i = 0; i < world.landmarks.size(); ++i) {
    if (i % 50 == 0) pictures.emplace_back();
    pictures.back().push_back(world.landmarks[i].descriptor);
  }
  const auto vocabulary = std::make_shared<const BinaryVocabulary>(
      BinaryVocabulary::train(pictures, {.branching = 8, .levels = 3}));
  Mapper mapper({}, vocabulary);
  test::TruthfulTracker tracker(world, mapper);
  std::vector<Turn> out;
  for (int turn = 0; turn < turns; ++turn) {
    Turn now;
    for (int step = 0; step < 40; ++step) {
      const double yaw = 2.0 * std::numbers::pi * step / 40.0;
      const auto update =
          tracker.step(test::standing_at({0.6 * std::sin(yaw), 0.0, 0.6 * std::cos(yaw)}, yaw));
      now.changed_points = std::max(now.changed_points, update.points.size());
    }
    now.key_frames = mapper.map().key_frames.size();
    now.points = mapper.map().points.size();
    now.planes = mapper.map().planes.size();
    now.bytes = format_map(mapper.saved()).size();
    now.worst_m = tracker.worst_m();
    out.push_back(now);
  }
  return out;
}

TEST(MapperMemory, IsBoundedOverTenThousandFramesOfALoop) {
  const auto turns = go_round(25);
  const Turn& early = turns[2];
  EXPECT_LT(early.key_frames, 40u);  // of 120 that came
  for (std::size_t i = 3; i < turns.size(); ++i) {
    EXPECT_LE(turns[i].key_frames, early.key_frames + 3) << i;
    EXPECT_LE(turns[i].points, early.points + early.points / 10) << i;
    EXPECT_EQ(turns[i].planes, early.planes) << i;
    EXPECT_LE(turns[i].changed_points, early.points) << i;
    EXPECT_LT(turns[i].worst_m, 0.05) << i;
  }
  // The planes' clouds fill up at first.
  EXPECT_LT(static_cast<double>(turns.back().bytes), 1.5 * static_cast<double>(early.bytes));
  EXPECT_LT(static_cast<double>(turns.back().bytes),
            1.02 * static_cast<double>(turns[turns.size() - 6].bytes));
}

}  // namespace
}  // namespace weft::slam
