#include "integration/test_stage.hpp"

#include <chrono>
#include <thread>

#include "base/hash.hpp"
#include "integration/test_log.hpp"
#include "weft/foreground_t.hpp"
#include "weft/part_detections_t.hpp"
#include "weft/probability_map_t.hpp"
#include "weft/rgbd_frame_t.hpp"
#include "weft/words_t.hpp"

namespace weft::test_stage {
namespace {

using Kind = TestStageOptions::Kind;

weft::view_t plain_view(int width, int height) {
  weft::view_t view{};
  view.kind = weft::view_t::SENSOR;
  view.width = width;
  view.height = height;
  for (int i = 0; i < 9; i += 4) view.sensor_from_view[i] = 1.0;
  return view;
}

class TestStage : public stage::Stage {
 public:
  explicit TestStage(const TestStageOptions& options) : options_(options) {
    interface_.settings_hash = options_hash(options);
    interface_.stateful = options.stateful;
    switch (options.kind) {
      case Kind::kMask:
        interface_.name = "mask";
        interface_.inputs = {stage::port<weft::rgbd_frame_t>("RGBD_FRAME")};
        interface_.outputs = {stage::port<weft::foreground_t>("FOREGROUND")};
        break;
      case Kind::kWords:
        interface_.name = "words";
        interface_.inputs = {stage::port<weft::rgbd_frame_t>("RGBD_FRAME"),
                             stage::port<weft::foreground_t>("FOREGROUND")};
        interface_.outputs = {stage::port<weft::words_t>("WORDS_SIFT")};
        break;
      case Kind::kTrack:
        interface_.name = "track";
        interface_.inputs = {
            stage::port<weft::rgbd_frame_t>("RGBD_FRAME"),
            stage::feedback_port<weft::words_t>("WORDS_SIFT", options.frames_back)};
        interface_.outputs = {stage::port<weft::foreground_t>("FOREGROUND")};
        break;
      case Kind::kParts:
        interface_.name = "parts";
        interface_.inputs = {stage::port<weft::words_t>("WORDS_SIFT")};
        interface_.outputs = {stage::port<weft::probability_map_t>("PROBABILITY_MAP"),
                              stage::port<weft::part_detections_t>("PART_DETECTIONS")};
        break;
    }
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    std::this_thread::sleep_for(std::chrono::milliseconds(options_.work_ms));
    if (options_.fail_every > 0 && inputs.header().seq % options_.fail_every == 0)
      throw Error("this frame was to fail");
    if (options_.impure) ++calls_;
    switch (options_.kind) {
      case Kind::kMask:
      case Kind::kTrack:
        return mask(inputs, outputs);
      case Kind::kWords:
        return words(inputs, outputs);
      case Kind::kParts:
        return parts(inputs, outputs);
    }
  }

 private:
  void mask(const stage::Inputs& inputs, stage::Outputs& outputs) {
    const auto& frame = inputs.get<weft::rgbd_frame_t>("RGBD_FRAME");
    auto& out = outputs.at<weft::foreground_t>("FOREGROUND");
    Hash64 hash;
    hash.add(frame.data.data(), frame.data.size());
    if (options_.kind == Kind::kTrack) {
      if (const auto* words = inputs.feedback<weft::words_t>("WORDS_SIFT")) {
        hash.add(static_cast<std::uint64_t>(words->header.seq));
        hash.add(words->cells.data(), words->cells.size() * sizeof words->cells[0]);
      }
    }
    if (options_.stateful) {
      hash.add(before_);
      before_ = hash.value();
    }
    out.width = frame.camera_model.width;
    out.height = frame.camera_model.height;
    const int pixels = out.width * out.height;
    const int garment = static_cast<int>(hash.value() % static_cast<unsigned>(pixels - 1)) + 1;
    out.runs = {(pixels - garment) / 2, garment, pixels - garment - (pixels - garment) / 2};
    out.run_count = 3;
    out.garment_px = garment + calls_;
  }

  void words(const stage::Inputs& inputs, stage::Outputs& outputs) {
    const auto& foreground = inputs.get<weft::foreground_t>("FOREGROUND");
    auto& out = outputs.at<weft::words_t>("WORDS_SIFT");
    out.descriptor = "sift";
    out.vocabulary_size = 128;
    out.view = plain_view(foreground.width, foreground.height);
    out.step_px = 6;
    out.columns = foreground.width / 6;
    out.rows = foreground.height / 6;
    out.cell_count = out.columns * out.rows;
    for (int i = 0; i < out.cell_count; ++i)
      out.cells.push_back(
          static_cast<std::int16_t>((foreground.garment_px + i * 7 + calls_) % 128));
  }

  void parts(const stage::Inputs& inputs, stage::Outputs& outputs) {
    const auto& words = inputs.get<weft::words_t>("WORDS_SIFT");
    auto& maps = outputs.at<weft::probability_map_t>("PROBABILITY_MAP");
    maps.view = words.view;
    maps.step_px = words.step_px;
    maps.columns = words.columns;
    maps.rows = words.rows;
    weft::part_map_t map;
    map.part = "polo collar";
    map.full_scale = 1.0;
    for (const auto cell : words.cells) map.values.push_back(static_cast<std::uint8_t>(2 * cell));
    map.value_count = static_cast<std::int32_t>(map.values.size());
    maps.maps = {map};
    maps.map_count = 1;
    auto& found = outputs.at<weft::part_detections_t>("PART_DETECTIONS");
    found.view = words.view;
    weft::part_detection_t detection{};
    detection.part = "polo collar";
    detection.probability = words.cells.front() / 128.0;
    const double left = words.cells.front(), top = words.cells.back();
    const double corners[4][2] = {
        {left, top}, {left + 80, top}, {left + 80, top + 60}, {left, top + 60}};
    std::copy(&corners[0][0], &corners[0][0] + 8, &detection.corners_sensor[0][0]);
    detection.centre_sensor[0] = left + 40;
    detection.centre_sensor[1] = top + 30;
    found.detections = {detection};
    found.detection_count = 1;
    if (words.cells.front() < 16) outputs.nothing(stage::Reason::kNothingFound, "no part");
  }

  TestStageOptions options_;
  stage::Interface interface_;
  int calls_ = 0;
  std::uint64_t before_ = 0;
};

class TestSource : public stage::Source {
 public:
  explicit TestSource(const TestSourceOptions& options) : options_(options) {
    interface_.name = "camera";
    interface_.settings_hash = options_hash(options);
    interface_.outputs = {stage::port<weft::rgbd_frame_t>("RGBD_FRAME")};
    if (options.log.empty()) return;
    stage::LogReader log(options.log);
    for (stage::LogEvent event; log.next(event);) {
      weft::rgbd_frame_t frame{};
      const int size = static_cast<int>(event.data.size());
      if (event.channel == "RGBD_FRAME" && frame.decode(event.data.data(), 0, size) == size)
        frames_.push_back(std::move(frame));
    }
    if (frames_.empty()) throw Error(options.log + ": no whole frame");
  }
  const stage::Interface& interface() const override { return interface_; }
  bool next(stage::Outputs& outputs, const std::stop_token& stop) override {
    if (stop.stop_requested() || (options_.frames > 0 && seq_ == options_.frames)) return false;
    auto& out = outputs.at<weft::rgbd_frame_t>("RGBD_FRAME");
    if (frames_.empty()) {
      fill_test_frame(seq_, static_cast<std::size_t>(options_.bytes), out);
    } else {
      const auto header = out.header;
      out = frames_[static_cast<std::size_t>(seq_) % frames_.size()];
      out.header = header;
    }
    ++seq_;
    return true;
  }

 private:
  TestSourceOptions options_;
  std::vector<weft::rgbd_frame_t> frames_;
  stage::Interface interface_;
  std::int64_t seq_ = 0;
};

}  // namespace

std::unique_ptr<stage::Source> make_source(const Settings& settings) {
  TestSourceOptions options;
  settings.read(options);
  return std::make_unique<TestSource>(options);
}

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  TestStageOptions options;
  settings.read(options);
  return std::make_unique<TestStage>(options);
}

}  // namespace weft::test_stage
