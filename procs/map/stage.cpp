#include "procs/map/stage.hpp"

#include <cstdio>
#include <optional>

#include "base/hash.hpp"
#include "messages/map.hpp"
#include "slam/map_file.hpp"
#include "slam/map_history.hpp"
#include "slam/mapper.hpp"

namespace weft::map_process {
namespace {

struct MapOptions {
  std::string vocabulary = "../models/places-orb/vocabulary.blob";
  std::string load;
  std::string save;
  int save_every = 20;
  slam::MapperOptions mapper;

  void visit(OptionVisitor& v) {
    v.field("vocabulary", vocabulary,
            "finds loops; relative to this file; empty: no loop is closed");
    v.field("load", load,
            "map file to go on in, relative to this file; empty: begin a new map. Give weft-track "
            "wait_for_mapper");
    v.field("save", save,
            "write the map to this file, relative to this file, at the end of a session and when "
            "the process stops; may be the one that is loaded; empty: do not");
    v.field("save_every", save_every, {0, 1'000'000}, "key frames",
            "and each time so many have come, for a process that is killed; 0: only at the end");
    v.group("mapper", mapper);
  }
  void validate() const {
    validate_fields(*this, "MapOptions");
    mapper.validate();
  }
};

class MapStage : public stage::Stage {
 public:
  /// save: path, or empty.
  MapStage(const MapOptions& options, std::shared_ptr<const slam::BinaryVocabulary> vocabulary,
           std::optional<slam::SavedMap> loaded, std::string save)
      : options_(options),
        vocabulary_(std::move(vocabulary)),
        loaded_(std::move(loaded)),
        save_(std::move(save)) {
    interface_.name = "map";
    interface_.inputs = {stage::port<keyframe_t>("KEYFRAME")};
    interface_.outputs = {stage::port<map_update_t>("MAP_UPDATE")};
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
    if (options_.save_every > 0 && unsaved_ >= options_.save_every) save();
  }

 private:
  void begin(const header_t& header) {
    camera_ = header.camera;
    session_ = header.session;
    if (loaded_)
      mapper_.emplace(options_.mapper, vocabulary_, *loaded_);
    else
      mapper_.emplace(options_.mapper, vocabulary_);
    history_.begin(mapper_->map().version);
    starter_ = -1;
    unsaved_ = 0;
    Hash64 hash;
    hash.add(camera_);
    for (const std::int64_t each : {session_, header.seq}) hash.add(std::to_string(each));
    if (loaded_) hash.add(to_hex(loaded_hash_));
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

  void save() {
    if (save_.empty() || unsaved_ == 0) return;
    unsaved_ = 0;
    slam::write_map(save_, mapper_->saved());
  }

  MapOptions options_;
  std::shared_ptr<const slam::BinaryVocabulary> vocabulary_;
  std::optional<slam::SavedMap> loaded_;
  std::uint64_t loaded_hash_ = 0;
  std::string save_;
  stage::Interface interface_;
  std::string camera_;
  std::int64_t session_ = 0;
  std::optional<slam::Mapper> mapper_;
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
  if (!options.load.empty()) {
    loaded = slam::read_map(settings.path(options.load));
    loaded->frame = -1;  // frames of the session to come count from 0 again
  }
  return std::make_unique<MapStage>(options, std::move(vocabulary), std::move(loaded),
                                    options.save.empty() ? "" : settings.path(options.save));
}

std::string settings_reference() { return options_to_yaml(MapOptions{}); }

}  // namespace weft::map_process
