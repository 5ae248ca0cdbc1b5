#include "procs/track/stage.hpp"

#include <optional>

#include "messages/map.hpp"
#include "messages/planes.hpp"
#include "messages/rgbd.hpp"
#include "slam/features.hpp"
#include "slam/map_history.hpp"
#include "slam/tracker.hpp"

namespace weft::track_process {
namespace {

/// More features and their points' ids do not fit a KEYFRAME message.
constexpr int kMaxFeatures = 2000;

struct TrackOptions {
  std::string vocabulary = "../models/places-orb/vocabulary.blob";
  int map_delay = 1;
  bool wait_for_mapper = false;
  slam::FeatureOptions features;
  slam::TrackerOptions tracker;

  void visit(OptionVisitor& v) {
    v.field(
        "vocabulary", vocabulary,
        "finds the place again when lost; relative to this file; empty: only near where it was");
    v.field("map_delay", map_delay, {1, stage::kMaxFramesBack}, "frames",
            "MAP_UPDATE of so many frames before is taken over: 1 for the newest map; more lets "
            "tracking go on while the mapper works");
    v.field("wait_for_mapper", wait_for_mapper,
            "start no map before the mapper has said which one it has: for a mapper that goes on "
            "with a map from a file");
    v.group("features", features);
    v.group("tracker", tracker);
  }
  void validate() const {
    validate_fields(*this, "TrackOptions");
    features.validate();
    tracker.validate();
    if (features.features > kMaxFeatures)
      throw Error("TrackOptions: features.features = " + std::to_string(features.features) +
                  " are more than the " + std::to_string(kMaxFeatures) +
                  " that fit a KEYFRAME message");
    if (features.levels > tracker.levels)
      throw Error("TrackOptions: features.levels = " + std::to_string(features.levels) +
                  " exceeds tracker.levels = " + std::to_string(tracker.levels));
  }
};

class TrackStage : public stage::Stage {
 public:
  TrackStage(const TrackOptions& options, std::shared_ptr<const slam::BinaryVocabulary> vocabulary)
      : options_(options), features_(options.features), tracker_(options.tracker, vocabulary) {
    interface_.name = "track";
    interface_.inputs = {stage::port<rgbd_frame_t>("RGBD_FRAME")};
    if (options_.tracker.use_planes) interface_.inputs.push_back(stage::port<planes_t>("PLANES"));
    interface_.inputs.push_back(
        stage::feedback_port<map_update_t>("MAP_UPDATE", options_.map_delay));
    interface_.outputs = {stage::port<camera_pose_t>("CAMERA_POSE"),
                          stage::port<keyframe_t>("KEYFRAME")};
    auto hashed = options_;
    hashed.vocabulary.clear();
    interface_.settings_hash = options_hash(hashed);
    if (vocabulary) interface_.model_hash = vocabulary->hash();
    interface_.stateful = true;
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const header_t& header = inputs.header();
    if (!session_ || session_->first != header.camera || session_->second != header.session) {
      session_.emplace(header.camera, header.session);
      tracker_session_ = header.seq;
      tracker_.reset();
      map_id_ = 0;
      mapper_ = {};
    }
    if (const auto* update = inputs.feedback<map_update_t>("MAP_UPDATE")) take_over(*update);

    slam::TrackedFrame tracked;
    const std::string waits = wait_reason();
    if (waits.empty()) {
      tracked = tracker_.track(read(inputs));
    } else {
      tracked.frame = header.seq;
      tracked.utime = header.utime;
      tracked.reason = waits;
    }

    auto& pose = outputs.at<camera_pose_t>("CAMERA_POSE");
    pose.header.coordinate_frame = "world";
    const bool known = tracked.map_version > 0;
    messages::to_message(tracked, tracker_session_, known ? map_id_ : 0, pose);
    if (tracked.state != slam::TrackingState::kTracked)
      set_nothing(pose.status, stage::Reason::kNotTracked, tracked.reason);
    auto& key_frame = outputs.at<keyframe_t>("KEYFRAME");
    messages::to_message(tracked.key_frame ? &*tracked.key_frame : nullptr, tracker_session_,
                         {map_id_, map_id_ == 0 ? 0 : tracker_.map().version}, key_frame);
    if (!tracked.key_frame)
      set_nothing(key_frame.status, stage::Reason::kNoKeyFrame, "no key frame");
  }

 private:
  static void set_nothing(status_t& status, stage::Reason reason, const std::string& text) {
    status.code = status_t::NOTHING;
    status.reason = static_cast<std::int16_t>(reason);
    status.text = text;
  }

  slam::FrameInput read(const stage::Inputs& inputs) const {
    const rgbd::RgbdFrame frame = messages::from_message(
        inputs.get<rgbd_frame_t>("RGBD_FRAME"), {.colour = true, .depth = true, .mask = false});
    slam::FrameInput input;
    input.frame = inputs.header().seq;
    input.utime = inputs.header().utime;
    input.camera = frame.camera;
    input.features = features_.extract(frame);
    if (!options_.tracker.use_planes) return input;
    auto planes = messages::from_message(inputs.get<planes_t>("PLANES"), false);
    if (!(planes.camera == frame.camera) && !planes.extraction.planes.empty())
      throw stage::InvalidInput("PLANES: of another camera than RGBD_FRAME");
    input.planes = std::move(planes.extraction.planes);
    return input;
  }

  /// Updates that do not go on from the copy are passed over: KEYFRAME says what it is at, and the
  /// mapper's answer goes on from there.
  void take_over(const map_update_t& message) {
    mapper_ = {message.map_id, message.to_version};
    if (message.to_version == 0) {
      // The mapper has nothing (yet). Only a copy of another map of its is out of date: one that
      // waits for it to begin is not.
      if (map_id_ == 0 || message.map_id == map_id_) return;
      tracker_.reset();
      map_id_ = 0;
      return;
    }
    const bool whole = message.from_version == 0;
    const std::int64_t version = tracker_.map().version;
    const bool same = message.map_id == map_id_;
    if (same && message.to_version <= version) return;
    if (!whole && (!same || message.from_version > version)) return;
    tracker_.update(slam::continued_from(messages::from_message(message), tracker_.map()));
    map_id_ = message.map_id;
  }

  /// Why there can be no pose before the mapper has said more; empty: there can.
  std::string wait_reason() const {
    if (map_id_ != 0) return "";
    if (mapper_.version > 0) return "the mapper has a map, which has not come as a whole yet";
    if (options_.wait_for_mapper && mapper_.map_id == 0) return "the mapper has not been heard yet";
    return "";
  }

  TrackOptions options_;
  slam::FeatureExtractor features_;
  slam::Tracker tracker_;
  stage::Interface interface_;
  std::optional<std::pair<std::string, std::int64_t>> session_;  // camera, capture session
  std::int64_t tracker_session_ = 0;
  std::int64_t map_id_ = 0;    // of the tracker's copy; 0: none, or one the mapper has not taken up
  messages::MapState mapper_;  // as it said last
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  TrackOptions options;
  settings.read(options);
  std::shared_ptr<const slam::BinaryVocabulary> vocabulary;
  if (!options.vocabulary.empty())
    vocabulary = std::make_shared<slam::BinaryVocabulary>(
        slam::BinaryVocabulary::read(settings.path(options.vocabulary)));
  return std::make_unique<TrackStage>(options, std::move(vocabulary));
}

std::string settings_reference() { return options_to_yaml(TrackOptions{}); }

}  // namespace weft::track_process
