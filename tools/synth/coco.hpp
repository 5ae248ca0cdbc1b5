#pragma once

#include <nlohmann/json_fwd.hpp>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

/// Instance masks in the format of the COCO data set (https://cocodataset.org/#format-data).
namespace weft::synth {

/// The six states of T-shirts, then "desk". Category ids are 1 + index.
const std::vector<std::string>& coco_categories();

/// Run lengths down the columns, background first, as COCO's compressed string. mask: CV_8UC1.
std::string encode_rle(const cv::Mat& mask);

struct CocoInstance {
  int label = 0;         // in the image of instances
  std::string category;  // one of coco_categories()
  std::string simulation;
};

/// Annotations of one image, ids left out: category_id, segmentation (RLE), area, bbox, iscrowd 0,
/// and of our own: label, simulation. Instances of less than min_pixels are left out.
nlohmann::json coco_annotations(const cv::Mat& labels, const std::vector<CocoInstance>& instances,
                                int min_pixels);

/// A whole COCO file. images: objects with "image" (file_name, width, height, ...) and
/// "annotations"; ids are numbered from 1 in their order.
nlohmann::json coco_file(const std::vector<nlohmann::json>& images, const std::string& description);

}  // namespace weft::synth
