#include "slam/pipeline.hpp"

namespace weft::slam {

Pipeline::Pipeline(const PipelineOptions& options,
                   std::shared_ptr<const BinaryVocabulary> vocabulary)
    : options_(options),
      features_(options.features),
      planes_(options.planes),
      tracker_(options.tracker, vocabulary),
      mapper_(options.mapper, vocabulary) {
  options_.validate();
}

std::vector<Feature> Pipeline::see_features(const rgbd::RgbdFrame& frame) const {
  return features_.extract(frame);
}

std::vector<plane::PlaneSegment> Pipeline::see_planes(const rgbd::RgbdFrame& frame) const {
  return planes_.extract(frame).planes;
}

TrackedFrame Pipeline::track(const FrameInput& input) {
  while (!updates_.empty() && updates_.front().first + options_.map_delay <= input.frame) {
    take_over(updates_.front().second);
    updates_.pop_front();
  }
  auto tracked = tracker_.track(input);
  path_.add(tracked, tracker_.map());
  return tracked;
}

void Pipeline::map(const TrackedFrame& tracked) {
  if (tracked.key_frame) updates_.emplace_back(tracked.frame, mapper_.add(*tracked.key_frame));
}

TrackedFrame Pipeline::process(std::int64_t frame, std::int64_t utime,
                               const rgbd::RgbdFrame& images) {
  FrameInput input;
  input.frame = frame;
  input.utime = utime;
  input.camera = images.camera;
  input.features = see_features(images);
  if (options_.tracker.use_planes) input.planes = see_planes(images);
  auto tracked = track(input);
  map(tracked);
  return tracked;
}

void Pipeline::finish() {
  for (const auto& [frame, update] : updates_) take_over(update);
  updates_.clear();
}

void Pipeline::take_over(const MapUpdate& update) {
  path_.follow(update, tracker_.map());
  tracker_.update(update);
}

}  // namespace weft::slam
