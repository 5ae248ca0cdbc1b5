#include "procs/map/stage.hpp"

#include <algorithm>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <map>
#include <optional>

#include "base/hash.hpp"
#include "detector/grasp.hpp"
#include "messages/detections.hpp"
#include "messages/foreground.hpp"
#include "messages/grasp.hpp"
#include "messages/map.hpp"
#include "messages/map_objects.hpp"
#include "messages/rgbd.hpp"
#include "procs/map/sightings.hpp"
#include "slam/garment_map.hpp"
#include "slam/map_file.hpp"
#include "slam/map_history.hpp"
#include "slam/mapper.hpp"
#include "weft/camera_in_base_t.hpp"

namespace weft::map_process {
namespace {

constexpr int kMapsKept = 3;  // earlier ones, beside the file that is saved

struct MapOptions {
  std::string vocabulary = "../models/places-orb/vocabulary.blob";
  std::string load;
  std::string save;
  int save_every = 20;
  bool garments = false;
  int detection_delay = 10;
  int look_every = 10;
  std::vector<double> T_base_camera;
  int camera_in_base_delay = 0;
  SightingOptions sighting;
  slam::GarmentMapOptions garment_map;
  slam::MapperOptions mapper;

  void visit(OptionVisitor& v) {
    v.field("vocabulary", vocabulary,
            "finds loops; relative to this file; empty: no loop is closed");
    v.field("load", load,
            "map file to go on in, relative to this file, and in further sessions of the camera in "
            "what has become of it; empty: each session begins a new map. Give weft-track "
            "wait_for_mapper");
    v.field("save", save,
            "write the map to this file, relative to this file, at the end of a session and when "
            "the process stops; may be the one that is loaded. A map that does not go on in what "
            "the file holds moves that to FILE.1, the one before to FILE.2, up to 3; empty: do not "
            "save");
    v.field("save_every", save_every, {0, 1'000'000}, "key frames",
            "and each time so many have come, for a process that is killed; 0: only at the end");
    v.field("garments", garments,
            "keep garments in the map, by FOREGROUND, PART_DETECTIONS and GRASPS: MAP_OBJECTS");
    v.field("detection_delay", detection_delay, {1, stage::kMaxFramesBack}, "frames",
            "what was detected so many frames before is taken in, so that the map need not wait "
            "for the detector");
    v.field("look_every", look_every, {0, 1'000'000}, "frames",
            "garments are looked for in key frames, and in the first tracked frame after so many "
            "without: a camera that stays over a table makes no key frames; 0: in key frames only");
    v.field("T_base_camera", T_base_camera, {0, 16}, "",
            "pose of the camera in the robot's base, which MAP_OBJECTS then tells positions in as "
            "well: none, 7 numbers (x y z in m, quaternion x y z w) or the 16 of a 4x4 matrix row "
            "by row");
    v.field("camera_in_base_delay", camera_in_base_delay, {0, stage::kMaxFramesBack}, "frames",
            "for a camera on an arm: its pose in the base is what CAMERA_IN_BASE said of the frame "
            "so many before, at least 1; 0: it is T_base_camera");
    v.group("sighting", sighting);
    v.group("garment_map", garment_map);
    v.group("mapper", mapper);
  }
  void validate() const {
    validate_fields(*this, "MapOptions");
    mapper.validate();
    garment_map.validate();
    sighting.validate();
    if (camera_in_base_delay > 0 && !T_base_camera.empty()) {
      throw Error(
          "MapOptions: T_base_camera and camera_in_base_delay are both set; a camera either is "
          "fixed "
          "to the base or on an arm: leave one out");
    }
  }
  std::optional<slam::Rigid3d> base_from_camera() const {
    detector::GraspOptions grasp;  // the one place that reads such a pose
    grasp.T_base_camera = T_base_camera;
    grasp.validate();
    const auto T = detector::base_from_camera(grasp);
    if (!T) return std::nullopt;
    return slam::Rigid3d{Eigen::Quaterniond(T->linear()), T->translation()};
  }
};

class MapStage : public stage::Stage {
 public:
  /// save: path, or empty; saved_there: it is the file that was loaded.
  MapStage(const MapOptions& options, std::shared_ptr<const slam::BinaryVocabulary> vocabulary,
           std::optional<slam::SavedMap> loaded, std::string save, bool saved_there)
      : options_(options),
        vocabulary_(std::move(vocabulary)),
        loaded_(std::move(loaded)),
        goes_on_(loaded_.has_value()),
        save_(std::move(save)),
        saved_there_(saved_there),
        T_base_camera_(options.base_from_camera()) {
    interface_.name = "map";
    interface_.inputs = {stage::port<keyframe_t>("KEYFRAME")};
    interface_.outputs = {stage::port<map_update_t>("MAP_UPDATE")};
    if (options_.garments) {
      const int k = options_.detection_delay;
      interface_.inputs.push_back(stage::port<rgbd_frame_t>("RGBD_FRAME"));
      interface_.inputs.push_back(stage::port<camera_pose_t>("CAMERA_POSE"));
      interface_.inputs.push_back(stage::feedback_port<foreground_t>("FOREGROUND", k));
      interface_.inputs.push_back(stage::feedback_port<part_detections_t>("PART_DETECTIONS", k));
      interface_.inputs.push_back(stage::feedback_port<grasps_t>("GRASPS", k));
      if (options_.camera_in_base_delay > 0)
        interface_.inputs.push_back(stage::feedback_port<camera_in_base_t>(
            "CAMERA_IN_BASE", options_.camera_in_base_delay));
      interface_.outputs.push_back(stage::port<map_objects_t>("MAP_OBJECTS"));
    }
    auto hashed = options_;
    hashed.vocabulary = hashed.load = hashed.save = "";
    hashed.save_every = 0;
    interface_.settings_hash = options_hash(hashed);
    if (vocabulary_) interface_.model_hash = vocabulary_->hash();
    if (loaded_) {
      Hash64 hash;
      const auto bytes = slam::format_map(*loaded_);
      hash.add(bytes.data(), bytes.size());
      loaded_hash_ = hash.value();
      interface_.model_hash ^= loaded_hash_;
    }
    interface_.stateful = true;
  }
  MapStage(const MapStage&) = delete;
  MapStage& operator=(const MapStage&) = delete;
  ~MapStage() override {
    try {
      save();
    } catch (const std::exception& e) {
      std::fprintf(stderr, "weft-map: the map is lost: %s\n", e.what());
    }
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const header_t& header = inputs.header();
    if (!mapper_ || camera_ != header.camera || session_ != header.session) {
      save();
      begin(header);
    }
    const auto content = messages::from_message(inputs.get<keyframe_t>("KEYFRAME"));
    auto& message = outputs.at<map_update_t>("MAP_UPDATE");
    message.header.coordinate_frame = "world";
    if (content.key_frame) message.refused = add(content);

    const slam::Map& map = mapper_->map();
    const bool same = content.map.map_id == map_id_;
    const slam::MapUpdate update =
        history_.since(same ? content.map.version : 0, map, mapper_->frame());
    messages::to_message(update, map_id_, map, message);
    if (update.from_version == update.to_version) {
      message.status.code = status_t::NOTHING;
      message.status.reason = static_cast<std::int16_t>(stage::Reason::kNothingNew);
      message.status.text = map.version == 0 ? "there is no map yet" : "the reader has it all";
    }
    if (options_.garments) keep_garments(content, message.refused.empty(), inputs, outputs);
    if (options_.save_every > 0 && unsaved_ >= options_.save_every) save();
  }

 private:
  void begin(const header_t& header) {
    if (mapper_ && goes_on_) {
      loaded_ = mapper_->saved();
      loaded_->garments = garments_->saved();
    } else if (mapper_) {
      saved_there_ = false;
    }
    camera_ = header.camera;
    session_ = header.session;
    if (loaded_) {
      loaded_->frame = -1;  // frames of the session count from 0 again
      garments_.emplace(options_.garment_map, std::move(loaded_->garments));
      mapper_.emplace(options_.mapper, vocabulary_, *std::exchange(loaded_, std::nullopt));
    } else {
      garments_.emplace(options_.garment_map);
      mapper_.emplace(options_.mapper, vocabulary_);
    }
    history_.begin(mapper_->map().version);
    awaited_.clear();
    poses_.clear();
    last_look_ = header.seq;
    starter_ = -1;
    unsaved_ = 0;
    Hash64 hash;
    hash.add(camera_);
    for (const std::int64_t each : {session_, header.seq}) hash.add(std::to_string(each));
    if (goes_on_) hash.add(to_hex(loaded_hash_));
    map_id_ = static_cast<std::int64_t>(hash.value() >> 1) | 1;  // never 0
  }

  /// Why not; empty: it was added.
  std::string add(const messages::KeyFrameContent& content) {
    const slam::NewKeyFrame& key_frame = *content.key_frame;
    const bool empty = mapper_->map().key_frames.empty();
    // Of version 0 are the one that starts the map and those made before its tracker heard of it.
    if (key_frame.map_version == 0 && !empty && content.tracker_session != starter_)
      return "it would start a map; there is one";
    if (key_frame.map_version > 0 && content.map.map_id != map_id_)
      return "it was tracked in another map";
    try {
      history_.add(mapper_->add(key_frame));
    } catch (const Error& e) {
      return e.what();  // the map is as it was
    }
    if (empty) starter_ = content.tracker_session;
    ++unsaved_;
    return "";
  }

  /// A frame that what was detected in it is awaited for.
  struct Awaited {
    std::int64_t seq;
    slam::GarmentView view;
    rgbd_frame_t images;
  };

  void keep_garments(const messages::KeyFrameContent& content, bool added,
                     const stage::Inputs& inputs, stage::Outputs& outputs) {
    const header_t& header = inputs.header();
    const slam::Map& map = mapper_->map();
    const auto pose = messages::from_message(inputs.get<camera_pose_t>("CAMERA_POSE"));
    const auto look = [&](const slam::GarmentView& view) {
      awaited_.push_back({header.seq, view, inputs.get<rgbd_frame_t>("RGBD_FRAME")});
      last_look_ = header.seq;
    };
    if (content.key_frame && added)
      look({mapper_->report().key_frame, {}});
    else if (options_.look_every > 0 && header.seq - last_look_ >= options_.look_every &&
             pose.tracked.state == slam::TrackingState::kTracked && pose.map_id == map_id_ &&
             map.key_frames.contains(pose.tracked.reference))
      look({pose.tracked.reference, pose.tracked.T_camera_reference});
    garments_->follow(map);
    auto& message = outputs.at<map_objects_t>("MAP_OBJECTS");
    message.header.coordinate_frame = "world";
    messages::MapObjectsContent out{map_id_, map.version, std::nullopt, {}};
    try {
      take_in(inputs);
      out.T_base_world = base_from_world(inputs, pose);
    } catch (const Error& e) {  // the map itself is none the worse for it
      message.status.code = status_t::FAILED;
      message.status.reason = static_cast<std::int16_t>(stage::Reason::kInvalidInput);
      message.status.text = e.what();
    }
    // What has not come by now never will.
    std::erase_if(awaited_, [&](const Awaited& each) {
      return each.seq <= header.seq - stage::kMaxFramesBack;
    });
    if (message.status.code == status_t::FAILED) return;
    out.garments = garments_->garments();
    messages::to_message(out, message);
    if (out.garments.empty()) {
      message.status.code = status_t::NOTHING;
      message.status.reason = static_cast<std::int16_t>(stage::Reason::kNothingFound);
      message.status.text = "no garment has been seen";
    }
  }

  /// nullopt: not known for this frame.
  std::optional<slam::Rigid3d> base_from_world(const stage::Inputs& inputs,
                                               const messages::PoseContent& pose) {
    const bool tracked = pose.tracked.state == slam::TrackingState::kTracked;
    if (options_.camera_in_base_delay == 0) {
      if (!T_base_camera_ || !tracked) return std::nullopt;
      return *T_base_camera_ * pose.tracked.T_camera_world;
    }
    const std::int64_t seq = inputs.header().seq;
    poses_.erase(poses_.begin(), poses_.lower_bound(seq - stage::kMaxFramesBack));
    if (tracked && pose.map_id == map_id_) poses_[seq] = pose.tracked.T_camera_world;
    const auto* said = inputs.feedback<camera_in_base_t>("CAMERA_IN_BASE");
    if (!said || said->status.code != status_t::OK) return std::nullopt;
    const auto T_camera_world = poses_.find(said->header.seq);
    if (T_camera_world == poses_.end()) return std::nullopt;
    return messages::from_message(said->T_base_camera, "CAMERA_IN_BASE: T_base_camera") *
           T_camera_world->second;
  }

  void take_in(const stage::Inputs& inputs) {
    const auto* foreground = inputs.feedback<foreground_t>("FOREGROUND");
    const auto* detections = inputs.feedback<part_detections_t>("PART_DETECTIONS");
    const auto* grasps = inputs.feedback<grasps_t>("GRASPS");
    if (foreground && detections && grasps && foreground->header.seq == grasps->header.seq &&
        detections->header.seq == grasps->header.seq)
      take_in(*foreground, *detections, *grasps);
  }

  void take_in(const foreground_t& foreground, const part_detections_t& detections,
               const grasps_t& grasps) {
    const auto found = std::find_if(awaited_.begin(), awaited_.end(), [&](const Awaited& each) {
      return each.seq == grasps.header.seq;
    });
    if (found == awaited_.end()) return;
    const Awaited awaited = std::move(*found);
    awaited_.erase(found);
    if (!mapper_->map().key_frames.contains(awaited.view.key_frame)) return;  // culled since
    const auto frame =
        messages::from_message(awaited.images, {.colour = false, .depth = true, .mask = false});
    if (frame.depth.empty()) throw stage::InvalidInput("RGBD_FRAME: the frame has no depth");
    std::vector<slam::GarmentSighting> seen;
    if (foreground.status.code == status_t::OK) {
      const auto mask = messages::from_message(foreground).mask;
      if (mask.size() != frame.depth.size())
        throw stage::InvalidInput("FOREGROUND: the mask is not of the frame's size");
      seen = sight_garments(frame, mask, messages::from_message(detections).detections,
                            messages::from_message(grasps), options_.sighting);
    }
    garments_->add(mapper_->map(), awaited.view, seen);
  }

  void save() {
    if (save_.empty() || unsaved_ == 0) return;
    unsaved_ = 0;
    auto saved = mapper_->saved();
    saved.garments = garments_->saved();
    slam::format_map(saved);  // refuses what is too large before anything is moved
    if (!saved_there_) keep_earlier();
    saved_there_ = true;
    slam::write_map(save_, saved);
  }

  /// Moves what the file holds out of the way.
  void keep_earlier() const {
    namespace fs = std::filesystem;
    if (!fs::exists(save_)) return;
    const auto name = [&](int age) { return age == 0 ? save_ : save_ + "." + std::to_string(age); };
    try {
      for (int age = kMapsKept - 1; age >= 0; --age)
        if (fs::exists(name(age))) fs::rename(name(age), name(age + 1));
    } catch (const fs::filesystem_error& e) {
      throw Error(save_ + ": the map it holds cannot be kept as " + name(1) + ": " +
                  e.code().message());
    }
    std::fprintf(stderr, "weft-map: %s held another map; that is %s now\n", save_.c_str(),
                 name(1).c_str());
  }

  MapOptions options_;
  std::shared_ptr<const slam::BinaryVocabulary> vocabulary_;
  std::optional<slam::SavedMap> loaded_;  // that the next session goes on in
  bool goes_on_;                          // a new session, in the map that is there
  std::uint64_t loaded_hash_ = 0;
  std::string save_;
  bool saved_there_;  // the file holds what the present map came from
  std::optional<slam::Rigid3d> T_base_camera_;
  stage::Interface interface_;
  std::string camera_;
  std::int64_t session_ = 0;
  std::optional<slam::Mapper> mapper_;
  std::optional<slam::GarmentMap> garments_;
  std::deque<Awaited> awaited_;
  std::int64_t last_look_ = 0;                   // frame that garments were looked for in
  std::map<std::int64_t, slam::Rigid3d> poses_;  // T_camera_world by frame, of the last ones
  slam::MapHistory history_;
  std::int64_t map_id_ = 0;
  int unsaved_ = 0;            // key frames since the map was saved
  std::int64_t starter_ = -1;  // the tracker (its session) that started the map
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  MapOptions options;
  settings.read(options);
  std::shared_ptr<const slam::BinaryVocabulary> vocabulary;
  if (!options.vocabulary.empty())
    vocabulary = std::make_shared<slam::BinaryVocabulary>(
        slam::BinaryVocabulary::read(settings.path(options.vocabulary)));
  std::optional<slam::SavedMap> loaded;
  if (!options.load.empty()) loaded = slam::read_map(settings.path(options.load));
  const auto save = options.save.empty() ? "" : settings.path(options.save);
  const bool saved_there = loaded && !save.empty() && std::filesystem::exists(save) &&
                           std::filesystem::equivalent(save, settings.path(options.load));
  return std::make_unique<MapStage>(options, std::move(vocabulary), std::move(loaded), save,
                                    saved_there);
}

std::string settings_reference() { return options_to_yaml(MapOptions{}); }

}  // namespace weft::map_process
