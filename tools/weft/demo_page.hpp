#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "dataset/scene.hpp"
#include "tools/weft/frame_content.hpp"
#include "tools/weft/player.hpp"
#include "tools/weft/timing_report.hpp"

namespace weft {

/// The page that shows every frame with what was found in it: index.html and a folder frames/ of
/// images beside it.
class DemoPage {
 public:
  /// Empties FOLDER/frames. threshold: detections below it are hidden at first.
  DemoPage(std::filesystem::path folder, double threshold);
  ~DemoPage();
  /// truth: part polygons to show beside the detections, in px of the frame.
  void add(const PlayedFrame& frame, const FrameContent& content,
           const std::vector<dataset::PartPolygon>& truth);
  struct Figure {
    std::string name;
    std::string value;
    std::string kind;  // "", "good" or "bad"
  };
  void write(const std::string& title, const std::vector<Figure>& figures,
             const TimingReport& timing) const;

 private:
  struct Data;
  std::unique_ptr<Data> data_;
};

}  // namespace weft
