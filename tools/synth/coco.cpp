#include "synth/coco.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace weft::synth {

const std::vector<std::string>& coco_categories() {
  static const std::vector<std::string> names = {"flat",   "strip",  "stack", "fold-2",
                                                 "fold-4", "fold-s", "desk"};
  return names;
}

std::string encode_rle(const cv::Mat& mask) {
  std::vector<long> runs;
  bool on = false;
  long run = 0;
  for (int x = 0; x < mask.cols; ++x) {
    for (int y = 0; y < mask.rows; ++y) {
      if ((mask.at<std::uint8_t>(y, x) != 0) != on) {
        runs.push_back(run);
        run = 0;
        on = !on;
      }
      ++run;
    }
  }
  runs.push_back(run);
  // Differences to the run before last, five bits a character, the sixth says that more follow.
  std::string out;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    long value = i > 2 ? runs[i] - runs[i - 2] : runs[i];
    for (bool more = true; more;) {
      long bits = value & 0x1f;
      value >>= 5;
      more = (bits & 0x10) != 0 ? value != -1 : value != 0;
      if (more) bits |= 0x20;
      out += static_cast<char>(bits + 48);
    }
  }
  return out;
}

nlohmann::json coco_annotations(const cv::Mat& labels, const std::vector<CocoInstance>& instances,
                                int min_pixels) {
  nlohmann::json out = nlohmann::json::array();
  const auto& names = coco_categories();
  for (const auto& instance : instances) {
    const auto category = std::find(names.begin(), names.end(), instance.category);
    if (category == names.end()) throw Error("COCO: there is no category " + instance.category);
    const cv::Mat mask = labels == instance.label;
    int area = 0, left = mask.cols, top = mask.rows, right = -1, bottom = -1;
    for (int y = 0; y < mask.rows; ++y) {
      for (int x = 0; x < mask.cols; ++x) {
        if (mask.at<std::uint8_t>(y, x) == 0) continue;
        ++area;
        left = std::min(left, x);
        right = std::max(right, x);
        top = std::min(top, y);
        bottom = y;
      }
    }
    if (area < std::max(1, min_pixels)) continue;
    out.push_back(
        {{"category_id", category - names.begin() + 1},
         {"segmentation", {{"size", {mask.rows, mask.cols}}, {"counts", encode_rle(mask)}}},
         {"area", area},
         {"bbox", {left, top, right - left + 1, bottom - top + 1}},
         {"iscrowd", 0},
         {"label", instance.label},
         {"simulation", instance.simulation}});
  }
  return out;
}

nlohmann::json coco_file(const std::vector<nlohmann::json>& images,
                         const std::string& description) {
  using nlohmann::json;
  json out = {{"info", {{"description", description}, {"version", "1"}}},
              {"licenses", json::array()},
              {"images", json::array()},
              {"annotations", json::array()},
              {"categories", json::array()}};
  int id = 0;
  for (const auto& name : coco_categories()) {
    out["categories"].push_back({{"id", ++id},
                                 {"name", name},
                                 {"supercategory", name == "desk" ? "furniture" : "t-shirt"}});
  }
  int annotation_id = 0;
  for (std::size_t i = 0; i < images.size(); ++i) {
    json image = images[i].at("image");
    image["id"] = i + 1;
    out["images"].push_back(std::move(image));
    for (json annotation : images[i].at("annotations")) {
      annotation["id"] = ++annotation_id;
      annotation["image_id"] = i + 1;
      out["annotations"].push_back(std::move(annotation));
    }
  }
  return out;
}

}  // namespace weft::synth
