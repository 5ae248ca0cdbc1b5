#pragma once

#include <memory>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "base/options.hpp"
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
  std::vector<cv::Point2f> outline;  // of the garment, px; empty when unknown
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

/// What the files of some sets do not say.
struct DatasetOptions {
  /// 0: what is known of the set, else 525 px, the usual default of Kinect-like sensors.
  double fx_px = 0.0, fy_px = 0.0;
  /// Negative: what is known of the set, else the image centre.
  double cx_px = -1.0, cy_px = -1.0;
  double depth_unit_m = 0.001;
  /// Registration of a pair whose depth is not registered: a point p px from the centre of the
  /// depth image is registration_scale p - registration_offset_px from the centre of the colour
  /// image (at scale 1 the colour image, moved by the offset, fits the depth). The depth is warped
  /// to the colour image. Empty offset: what is known of the set.
  double registration_scale = 1.0;
  std::vector<double> registration_offset_px = {};

  void visit(OptionVisitor& v) {
    v.field("fx_px", fx_px, {0.0, 1e5}, "px", "focal length; 0: what the set says, else 525");
    v.field("fy_px", fy_px, {0.0, 1e5}, "px", "focal length; 0: as fx_px");
    v.field("cx_px", cx_px, {-1.0, 1e5}, "px",
            "principal point; -1: what the set says, else the centre");
    v.field("cy_px", cy_px, {-1.0, 1e5}, "px",
            "principal point; -1: what the set says, else the centre");
    v.field("depth_unit_m", depth_unit_m, {1e-6, 1.0}, "m", "depth of one count of a depth image");
    v.field("registration_scale", registration_scale, {0.5, 2.0}, "",
            "size of the depth image's content in the colour image; with an offset only");
    v.field("registration_offset_px", registration_offset_px, {0, 2}, "px",
            "x, y: move of the colour image that makes it fit the depth, for a pair that is not "
            "registered; empty: what is known of the set");
  }
  void validate() const;
};

/// Opens a folder of scans, telling its kind from its files. Throws Error that says what was looked
/// for when it is none of these:
///   IRI layout (weft synth)   see iri.hpp
///   CTU                       cloA*.yaml, cloC*.png, cloD*.png
///   pairs                     X_rgb.png + X_depth.png, X.color.jpg + X.depth.png (any of png, jpg,
///                             ppm; rgb, color, colour)
///   organised clouds          X.pcd
/// A file parts.json beside the scans holds their part polygons (see parts_json.hpp).
std::unique_ptr<Dataset> open_dataset(const std::string& folder,
                                      const DatasetOptions& options = {});

/// One image pair or one organised cloud as a data set of one scene; depth is empty for a cloud.
std::unique_ptr<Dataset> open_scan(const std::string& colour_or_pcd, const std::string& depth,
                                   const DatasetOptions& options = {});

}  // namespace weft::dataset
