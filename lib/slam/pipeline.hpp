#pragma once

#include <deque>
#include <memory>

#include "plane/extractor.hpp"
#include "slam/camera_path.hpp"
#include "slam/features.hpp"
#include "slam/mapper.hpp"
#include "slam/tracker.hpp"

namespace weft::slam {

struct PipelineOptions {
  int map_delay = 1;
  FeatureOptions features;
  plane::ExtractorOptions planes;
  TrackerOptions tracker;
  MapperOptions mapper;

  void visit(OptionVisitor& v) {
    v.field("map_delay", map_delay, {1, 1000}, "frames",
            "from a key frame to the first frame that is tracked in the map with it");
    v.group("features", features);
    v.group("planes", planes);
    v.group("tracker", tracker);
    v.group("mapper", mapper);
  }
  void validate() const { validate_fields(*this, "PipelineOptions"); }

  /// Neither tracker nor mapper use planes.
  void without_planes() { tracker.use_planes = mapper.use_planes = false; }
};

/// Tracking and mapping in one thread, in the order of a lock-step replay: for evaluation and
/// tests. Its steps are called one by one, so that each can be timed.
class Pipeline {
 public:
  /// vocabulary: may be nullptr. Throws Error.
  Pipeline(const PipelineOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary);

  /// 1. What tracking needs of a frame. Frames count up.
  std::vector<Feature> see_features(const rgbd::RgbdFrame& frame) const;
  std::vector<plane::PlaneSegment> see_planes(const rgbd::RgbdFrame& frame) const;
  /// 2. Its pose, after what the mapper said map_delay frames before.
  TrackedFrame track(const FrameInput& input);
  /// 3. The map with it, if it is a key frame.
  void map(const TrackedFrame& tracked);

  /// All of them.
  TrackedFrame process(std::int64_t frame, std::int64_t utime, const rgbd::RgbdFrame& images);

  /// Takes over what the mapper said last; then path() is of the final map.
  void finish();

  const Map& map() const { return tracker_.map(); }
  const Mapper& mapper() const { return mapper_; }
  const CameraPath& path() const { return path_; }

 private:
  void take_over(const MapUpdate& update);

  PipelineOptions options_;
  FeatureExtractor features_;
  plane::Extractor planes_;
  Tracker tracker_;
  Mapper mapper_;
  std::deque<std::pair<std::int64_t, MapUpdate>> updates_;  // with the frame they came from
  CameraPath path_;
};

}  // namespace weft::slam
