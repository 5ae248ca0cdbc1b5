#pragma once

#include <memory>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "rgbd/frame.hpp"

namespace weft::dataset {

/// One annotated part instance, in px of the registered frame.
struct PartPolygon {
  std::string part;      // name of the paper's Table 1, lower case: "polo collar"
  std::string instance;  // "collar", "left", ...; may be empty
  std::vector<cv::Point2f> points;
  bool ignore = false;         // neither hit, miss nor negative
  double visible_share = 1.0;  // of the part's surface; 1 when unknown
};

/// A scan with what is known about it.
struct Scene {
  std::string name;
  rgbd::RgbdFrame frame;  // its mask is the data set's own, empty when there is none
  std::vector<PartPolygon> polygons;
  std::string
      garment;  // polo, jeans, tshirt, dress, shirt, sweater, towel, blanket; empty when unknown
  std::string
      simulation;      // scenes of one simulation (or scan) never stand on both sides of a split
  std::string split;   // "train", "test-seen", "test-held-out"; empty when the set has none
  bool easy = false;   // of the Easy subset
  bool single = true;  // shows one garment only: of the Complete subset
};

/// A folder of scans. Reading a scene throws Error naming the file and the reason; other scenes
/// stay readable.
class Dataset {
 public:
  virtual ~Dataset() = default;
  virtual const std::vector<std::string>& names() const = 0;
  virtual Scene read(std::size_t index) const = 0;
};

/// Opens a folder of scans, telling its kind (IRI layout, CTU, UC3M pairs, organised PCDs) from its
/// files. Throws Error that says what was looked for when it is none of them.
std::unique_ptr<Dataset> open_dataset(const std::string& folder);

}  // namespace weft::dataset
