#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "mapping_world.hpp"
#include "slam/loop_closer.hpp"

namespace weft::slam {
namespace {

using test::Landmark;
using test::MappingWorld;
using test::standing_at;
using test::TruthfulTracker;

/// Of the world's own landmarks, as pictures of it would give.
std::shared_ptr<const BinaryVocabulary> vocabulary_of(MappingWorld& world) {
  std::vector<std::vector<Descriptor>> pictures;
  for (std::size_t i = 0; i < world.landmarks.size(); ++i) {
    if (i % 50 == 0) pictures.emplace_back();
    pictures.back().push_back(world.landmarks[i].descriptor);
  }
  return std::make_shared<const BinaryVocabulary>(
      BinaryVocabulary::train(pictures, {.branching = 8, .levels = 3}));
}

/// Round the middle of a room, looking outwards: 40 steps a turn.
Rigid3d round_about(int step) {
  const double yaw = 2.0 * std::numbers::pi * step / 40.0;
  return standing_at({1.2 * std::sin(yaw), 0.0, 1.2 * std::cos(yaw)}, yaw);
}

/// Noise with which a turn drifts by some centimetres.
void blur(MappingWorld& world) {
  world.sigma_px = 1.5;
  world.inverse_depth_per_m = 0.006;
  world.features = 200;
}
MapperOptions blurred_options() {
  MapperOptions options;
  options.points.noise.sigma_px = 1.5;
  options.points.noise.inverse_depth_per_m = 0.006;
  return options;
}

TEST(Loop, ATurnInARoomCloses) {
  double error[2];
  for (const bool close : {false, true}) {
    MappingWorld world(11);
    world.add_room({0, 0, 0}, 5.0, 2.6, 300);
    world.rectangles.clear();
    blur(world);
    MapperOptions options = blurred_options();
    options.loops.close = close;
    Mapper mapper(options, vocabulary_of(world));
    TruthfulTracker tracker(world, mapper);
    Map copy;
    int loops = 0, closed_at = -1;
    for (int step = 0; step < 56; ++step) {
      apply(tracker.step(round_about(step)), copy);
      ASSERT_EQ(test::inconsistency(mapper.map()), "") << step;
      if (!mapper.report().loop) continue;
      ++loops;
      closed_at = step;
      EXPECT_GE(mapper.report().loop->matches, 40);
      EXPECT_TRUE(test::same(copy, mapper.map()));
    }
    error[close] = tracker.aligned_error_m();
    EXPECT_EQ(loops > 0, close);
    if (close) {
      EXPECT_GE(closed_at, 36);
    }
  }
  EXPECT_LT(error[1], 0.5 * error[0]);
}

/// A corridor whose wall repeats every 4 m, to the descriptor. The camera passes along it.
void add_repeating_wall(MappingWorld& world) {
  MappingWorld pattern(13);
  pattern.add_wall({{0, -1.3, 0}, {0, 2.6, 0}, {4, 0, 0}}, 250);
  for (int k = 0; k < 6; ++k)
    for (Landmark landmark : pattern.landmarks) {
      landmark.position_world += Eigen::Vector3d(4.0 * k - 2.0, 0, 2.0);
      world.landmarks.push_back(landmark);
    }
  world.rectangles.push_back({{-2, -1.3, 2.0}, {0, 2.6, 0}, {24, 0, 0}});
}

TEST(Loop, WhatLooksTheSameElsewhereIsNoLoop) {
  int found[2] = {0, 0};
  for (const bool guarded : {false, true}) {
    MappingWorld world(12);
    add_repeating_wall(world);
    MapperOptions options;
    if (!guarded) {
      options.loops.max_drift_m = 100.0;
      options.loops.max_strain = 1e9;
    }
    Mapper mapper(options, vocabulary_of(world));
    TruthfulTracker tracker(world, mapper);
    for (int step = 0; step < 60; ++step) {
      tracker.step(standing_at({0.25 * step, 0.0, 0.0}, 0.0));
      found[guarded] += mapper.report().loop.has_value() || mapper.report().loop_refused;
      if (found[0] && !guarded) break;
    }
    if (guarded) {
      EXPECT_LT(tracker.worst_m(), 0.1);  // a wrong loop is 4 m
    }
  }
  EXPECT_GT(found[0], 0) << "the world does not look alike enough to deceive";
  EXPECT_EQ(found[1], 0);
}

}  // namespace
}  // namespace weft::slam
