#pragma once

#include "dataset/scene.hpp"
#include "synth/view_scene.hpp"

namespace weft::synth {

/// What is known of a part instance in a view, annotated or not.
struct PartRecord {
  std::string part, instance;
  double visible_share = 0.0;  // of the surface a flat garment would show
  double inside_share = 0.0;   // of what is seen: inner face
  double cut_off_share = 0.0;  // of what a larger sensor would see: beyond the frame
  int pixels = 0;
  bool annotated = false;  // has a polygon
  bool ignore = false;
};

struct Annotation {
  std::vector<dataset::PartPolygon> polygons;  // of instances with at least one visible piece
  std::vector<PartRecord> records;             // of all instances, in the simulation's order
  cv::Mat labels;                              // CV_8UC1, see dataset/iri.hpp
};

/// Polygons of the object's part instances: the hull of the visible pieces that lie within 5 cm of
/// each other (the group with most pixels), grown by 2.5 px, clipped to the frame. A part is
/// ignored that is less than a quarter visible, covers less than nine grid points (6 px apart), is
/// seen from the inside only (but for neck and waistband), or more than half cut off.
Annotation annotate(const ViewScene& scene, const IdealImages& images, const ViewRecipe& recipe,
                    const Simulation& simulation, std::size_t object);

}  // namespace weft::synth
