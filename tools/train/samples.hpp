#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "bovw/describe.hpp"
#include "dataset/scene.hpp"
#include "detector/types.hpp"

/// Described training views of a scene: the scene's own view turned and mirrored within its plane.
namespace weft::train {

struct AugmentOptions {
  int turns = 2;
  bool mirror = true;

  void visit(OptionVisitor& v) {
    v.field("turns", turns, {1, 36}, "",
            "views of each scene, evenly turned round the view's normal from an angle of the "
            "scene's own; SIFT words know up and down, garments do not");
    v.field("mirror", mirror, "each of them mirrored as well; some sensors mirror their images");
  }
  void validate() const { validate_fields(*this, "AugmentOptions"); }
};

/// An annotated part instance in a view.
struct ViewPart {
  int part = 0;  // index in detector::kParts
  bool ignore = false;
  double visible_share = 1.0;
  std::vector<cv::Point2f> polygon;  // view px
  detector::Box box;                 // bounds of the polygon
};

struct DescribedView {
  bovw::Described described;
  std::vector<ViewPart> parts;
};

struct DescribedScene {
  std::string name;
  std::string simulation;
  std::string garment;
  std::uint64_t data_hash = 0;  // of images and annotation
  std::vector<DescribedView> views;
};

/// The view turned by an angle about the garment's centre, mirrored before that when asked for,
/// just holding the garment again. Only for rectified views. margin_px: table shown around it.
rgbd::View turned_view(const rgbd::View& view, const cv::Mat& view_mask, double angle_rad,
                       bool mirrored, int margin_px);

/// Hash of everything a scene brings into training.
std::uint64_t hash_scene(const dataset::Scene& scene);

/// Foreground from the scene's own mask, table plane from its depth, then all views. The sensor
/// view of the `paper` preset is not turned, only the scene's own view is used. Throws Error when
/// the scene has no mask or no table.
DescribedScene describe_scene(const dataset::Scene& scene, const bovw::DescribeOptions& options,
                              const AugmentOptions& augment);

/// Reads what write_scene wrote; false when the file is not there or its key is another.
bool read_scene(const std::string& path, std::uint64_t key, DescribedScene& scene);
void write_scene(const std::string& path, std::uint64_t key, const DescribedScene& scene);

/// Parts of the scene in view px; unknown part names throw Error.
std::vector<ViewPart> parts_in_view(const std::vector<dataset::PartPolygon>& polygons,
                                    const rgbd::View& view);

}  // namespace weft::train
