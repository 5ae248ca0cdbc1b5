#pragma once

#include <malloc.h>
#include <unistd.h>

#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "mapping_world.hpp"
#include "slam/pipeline.hpp"

/// Tracking and mapping together on a camera that goes round and round in a room, 200 frames a
/// turn, 30 a second: what they hold must stop growing.
namespace weft::slam::test {

/// After each turn.
struct LoopState {
  std::int64_t frames = 0;
  std::size_t key_frames = 0, points = 0, planes = 0;
  int asked = 0;  // key frames so far
  double resident_mb = 0.0;
  int lost = 0;          // frames of this turn
  double worst_m = 0.0;  // largest error of a pose of this turn as it was said
};

/// What the process has in memory, once the allocator has given back what is free.
inline double resident_mb() {
  malloc_trim(0);
  std::ifstream in("/proc/self/statm");
  double all = 0.0, resident = 0.0;
  in >> all >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1e6;
}

class LoopingRun {
 public:
  static constexpr int kTurn = 200;  // frames

  LoopingRun() : world_(41) {
    world_.add_room({0, 0, 0}, 5.0, 2.6, 1200);
    world_.features = 5000;
    std::vector<std::vector<Descriptor>> pictures;
    for (std::size_t i = 0; i < world_.landmarks.size(); ++i) {
      if (i % 50 == 0) pictures.emplace_back();
      pictures.back().push_back(world_.landmarks[i].descriptor);
    }
    vocabulary_ = std::make_shared<const BinaryVocabulary>(
        BinaryVocabulary::train(pictures, {.branching = 8, .levels = 3}));
    pipeline_ = std::make_unique<Pipeline>(PipelineOptions{}, vocabulary_);
  }

  LoopState turn() {
    LoopState now;
    for (int step = 0; step < kTurn; ++step, ++frame_) {
      // No two turns are the same.
      const auto wave = [&](double frames) {
        return std::sin(2.0 * std::numbers::pi * static_cast<double>(frame_) / frames);
      };
      const double yaw = 2.0 * std::numbers::pi * step / kTurn, radius_m = 0.8 + 0.3 * wave(1730.0);
      const auto T_camera_world = standing_at(
          {-radius_m * std::sin(yaw), 0.2 * wave(977.0), -radius_m * std::cos(yaw)}, yaw);
      if (frame_ == 0) T_first_ = T_camera_world;
      const auto tracked =
          pipeline_->track(world_.see(frame_, frame_ * 33333, T_camera_world).input);
      pipeline_->map(tracked);
      asked_ += tracked.key_frame ? 1 : 0;
      if (tracked.state != TrackingState::kTracked) {
        ++now.lost;
        continue;
      }
      const Eigen::Vector3d truth = (T_camera_world * T_first_.inverse()).inverse().translation;
      now.worst_m =
          std::max(now.worst_m, (tracked.T_camera_world.inverse().translation - truth).norm());
    }
    now.frames = frame_;
    now.asked = asked_;
    now.key_frames = pipeline_->map().key_frames.size();
    now.points = pipeline_->map().points.size();
    now.planes = pipeline_->map().planes.size();
    now.resident_mb = test::resident_mb();
    return now;
  }
  Pipeline& pipeline() { return *pipeline_; }

 private:
  MappingWorld world_;
  std::shared_ptr<const BinaryVocabulary> vocabulary_;
  std::unique_ptr<Pipeline> pipeline_;
  std::int64_t frame_ = 0;
  int asked_ = 0;
  Rigid3d T_first_;
};

}  // namespace weft::slam::test
