#pragma once

#include <memory>
#include <optional>
#include <string>

#include "dataset/scene.hpp"

/// The layout of the IRI clothing parts data set (papers/garment-parts.txt, section 4): one folder
/// with
///
///   png/NAME.png            colour, 8 bits
///   pcd/NAME.pcd            organised cloud, PCD v0.7, metres, camera frame
///   masks/NAME.png          255 = the main garment
///   annotations/NAME.txt    ground truth, see below
///   labels/NAME.png         optional, part of each pixel, as the annotation's comments say
///
/// The text file of the paper is lost; ours explains itself: "key: value" lines, '#' starts a
/// comment, "part:" begins a part whose "instance:", "visible:", "ignore:" and "polygon:" follow.
/// Keys are told apart without regard to case, '=' may stand for ':', numbers may be separated by
/// blanks, commas, semicolons or brackets, unknown keys are skipped.
namespace weft::dataset {

struct IriAnnotation {
  std::optional<rgbd::CameraModel> camera;
  std::string garment, simulation, split;
  bool easy = false;
  bool single = true;
  std::vector<PartPolygon> polygons;
};

/// Throws Error naming `where`, the line and what was expected.
IriAnnotation parse_iri_annotation(const std::string& text, const std::string& where);

/// The text of a scene's annotation.
std::string format_iri_annotation(const Scene& scene);

/// Whether the folder looks like this layout.
bool is_iri(const std::string& folder);

/// Opens a folder of this layout; a scene is one that has an annotation. Throws Error when the
/// folder holds none.
std::unique_ptr<Dataset> open_iri(const std::string& folder);

/// Writes a scene; the folders are made where missing. Every file appears whole or not at all, the
/// annotation last. labels: CV_8UC1 or empty. Throws Error when a file cannot be written.
void write_iri(const std::string& folder, const Scene& scene, const cv::Mat& labels);

}  // namespace weft::dataset
