#pragma once

#include <memory>
#include <string>

#include "dataset/scene.hpp"

/// Scenes turned and mirrored, to judge detections over many views of few scans.
namespace weft::dataset {

struct Augmentation {
  double angle_deg = 0.0;  // clockwise on the screen
  bool mirror = false;     // left and right swapped, before the turn

  bool identity() const { return angle_deg == 0.0 && !mirror; }
  /// "" for the identity, else "@r45", "@r45m", "@r22.5"
  std::string suffix() const;
};

/// "00023@r45m" into "00023" and its augmentation. Throws Error on anything else after an @.
std::pair<std::string, Augmentation> parse_augmented_name(const std::string& name);

/// A camera rolled about its optical axis, and mirrored: images, polygons, outline and intrinsics
/// agree as before, depths are the same. The canvas grows to hold every pixel; where it shows
/// nothing, colour is that of the nearest border pixel, depth and mask are 0. Quarter turns are
/// exact, others interpolate colour (bilinear) and take the nearest depth and mask.
Scene augment(const Scene& scene, const Augmentation& augmentation);

struct AugmentOptions {
  int rotations = 1;
  bool mirror = false;

  void visit(OptionVisitor& v) {
    v.field("rotations", rotations, {1, 360}, "",
            "each scene is shown in so many rotations, evenly spread over a full turn");
    v.field("mirror", mirror, "each rotation is shown mirrored, too");
  }
  void validate() const { validate_fields(*this, "AugmentOptions"); }
};

/// Every scene in every rotation, its name followed by the suffix.
std::unique_ptr<Dataset> augment(std::unique_ptr<Dataset> dataset, const AugmentOptions& options);

/// Reads a scene by its name, with or without a suffix. Throws Error when the set has none of that
/// name.
Scene read_scene(const Dataset& dataset, const std::string& name);

}  // namespace weft::dataset
