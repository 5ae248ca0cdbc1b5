#include "evaluate/judge.hpp"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/parallel.hpp"
#include "dataset/augment.hpp"
#include "foreground/foreground.hpp"
#include "messages/detections.hpp"
#include "messages/foreground.hpp"
#include "messages/rgbd.hpp"
#include "stage/log.hpp"

namespace weft::evaluate {
namespace {

using evaluation::JudgedImage;

using FrameName = std::tuple<std::string, std::int64_t, std::int64_t>;

FrameName name_of(const header_t& header) { return {header.camera, header.session, header.seq}; }

template <class Message>
bool decode(const stage::LogEvent& event, Message& message) {
  const int size = static_cast<int>(event.data.size());
  return message.decode(event.data.data(), 0, size) == size;
}

}  // namespace

bool Selection::wants_name(const std::string& name) const {
  return scenes.empty() || std::find(scenes.begin(), scenes.end(),
                                     dataset::parse_augmented_name(name).first) != scenes.end();
}

bool Selection::wants(const dataset::Scene& scene) const {
  return wants_name(scene.name) && (split.empty() || scene.split == split) &&
         (!easy || scene.easy) && (several || scene.single);
}

JudgedByMode judge_dataset(const dataset::Dataset& data, const detector::Detector& detector,
                           const Selection& selection, bool live, int threads, int& failed,
                           const Report& report, const Note& note, const Observer& observer) {
  const auto& names = data.names();
  struct Result {
    JudgedImage image;
    std::vector<detector::PartPrior> priors;
  };
  std::vector<std::optional<Result>> results(names.size());
  std::mutex mutex;
  std::atomic<int> next{0};
  int done = 0;
  failed = 0;
  const auto problem = [&](const std::string& text) {
    const std::lock_guard lock(mutex);
    ++failed;
    note(text);
  };
  const auto judge = [&](std::size_t at) {
    if (!selection.wants_name(names[at])) return;
    const auto scene = data.read(at);
    if (!selection.wants(scene)) return;
    Result result;
    result.image.name = scene.name;
    result.image.truth = scene.polygons;
    try {
      foreground::ForegroundOptions options;
      if (!live && !scene.frame.mask.empty()) {
        options.mode = foreground::Foreground::Source::kDataset;
      }
      const auto foreground = foreground::find_foreground(scene.frame, options);
      result.image.mask = foreground.mask;
      auto detected = detector.detect(scene.frame, foreground.mask,
                                      foreground.table ? &*foreground.table : nullptr, 1);
      result.image.detections = std::move(detected.detections);
      result.priors = std::move(detected.priors);
    } catch (const Error& error) {
      problem(scene.name + ": " + error.what());
    }
    if (observer) {
      const std::lock_guard lock(mutex);
      observer(result.image, scene.frame.colour);
    }
    results[at] = std::move(result);
  };
  parallel_for(threads, threads, [&](int, int) {
    for (int i = next++; i < static_cast<int>(names.size()); i = next++) {
      try {
        judge(static_cast<std::size_t>(i));
      } catch (const Error& error) {
        problem("left out: " + std::string(error.what()));
      }
      const std::lock_guard lock(mutex);
      report(++done, static_cast<int>(names.size()));
    }
  });

  // Soft and hard follow from one search of all parts: a prior scales every score of its part, or
  // leaves the part out.
  JudgedByMode judged;
  for (auto& result : results) {
    if (!result) continue;
    auto soft = result->image, hard = result->image;
    const auto prior_of = [&](const detector::Detection& d) {
      return *std::find_if(result->priors.begin(), result->priors.end(),
                           [&](const detector::PartPrior& p) { return p.part == d.part; });
    };
    for (auto& d : soft.detections) d.probability *= prior_of(d).probability;
    std::erase_if(hard.detections, [&](const detector::Detection& d) {
      return prior_of(d).probability < prior_of(d).threshold;
    });
    judged["off"].push_back(std::move(result->image));
    judged["soft"].push_back(std::move(soft));
    judged["hard"].push_back(std::move(hard));
  }
  return judged;
}

std::vector<JudgedImage> judge_log(const std::string& log, const std::string& channel,
                                   const dataset::Dataset& data, const Selection& selection,
                                   int& failed, const Report& report, const Note& note,
                                   const Observer& observer) {
  struct Frame {
    std::string source;
    std::optional<std::vector<detector::Detection>> detections;  // none: not answered, or failed
    std::string problem = "not answered";
    cv::Mat mask, colour;
  };
  std::vector<FrameName> order;
  std::map<FrameName, Frame> frames;
  stage::LogReader reader(log);
  stage::LogEvent event;
  while (reader.next(event)) {
    if (event.channel == "RGBD_FRAME") {
      rgbd_frame_t message;
      if (!decode(event, message) || message.part_index != 0) continue;
      const auto name = name_of(message.header);
      if (!frames.contains(name)) order.push_back(name);
      auto& frame = frames[name];
      frame.source = message.source;
      if (observer && message.part_count == 1) {
        frame.colour = messages::from_message(message, {true, false, false}).colour;
      }
    } else if (event.channel == "FOREGROUND") {
      foreground_t message;
      if (decode(event, message) && message.status.code == status_t::OK) {
        frames[name_of(message.header)].mask = messages::from_message(message).mask;
      }
    } else if (event.channel == channel) {
      part_detections_t message;
      if (!decode(event, message)) continue;
      auto& frame = frames[name_of(message.header)];
      if (frame.detections) continue;  // a repeat
      if (message.status.code == status_t::NOTHING) {
        frame.detections.emplace();
      } else if (message.status.code == status_t::OK) {
        frame.detections = messages::from_message(message).detections;
      } else {
        frame.problem = message.status.text;
      }
    }
    report(static_cast<int>(reader.offset() / 1024), static_cast<int>(reader.size() / 1024));
  }
  for (const auto& damage : reader.damage()) note(log + ": " + damage.what);
  if (order.empty()) throw Error(log + " holds no RGBD_FRAME");

  std::vector<JudgedImage> images;
  failed = 0;
  for (const auto& name : order) {
    auto& frame = frames[name];
    if (!selection.wants_name(frame.source)) continue;
    const auto scene = dataset::read_scene(data, frame.source);
    if (!selection.wants(scene)) continue;
    JudgedImage image;
    image.name = frame.source;
    image.truth = scene.polygons;
    image.mask = frame.mask;
    if (frame.detections) {
      image.detections = std::move(*frame.detections);
    } else {
      ++failed;
      note(frame.source + ": " + frame.problem);
    }
    if (observer && !frame.colour.empty()) observer(image, frame.colour);
    images.push_back(std::move(image));
  }
  return images;
}

}  // namespace weft::evaluate
