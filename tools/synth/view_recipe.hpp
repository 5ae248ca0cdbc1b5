#pragma once

#include <vector>

#include "rgbd/camera_model.hpp"
#include "synth/fabric.hpp"
#include "synth/light.hpp"
#include "synth/table.hpp"

namespace weft::synth {

struct CameraPose {
  Vec3 origin = Vec3::Zero();  // world
  Vec3 right = Vec3::UnitX(), down = -Vec3::UnitY(), forward = -Vec3::UnitZ();
};

struct ColourSensor {
  float mean_level = 0.25f;   // linear, of the exposed picture
  float bright_level = 0.9f;  // linear, upper limit of what 97 % of the picture stay below
  Vec3 balance = Vec3::Ones();
  float blur_px = 0.6f;     // standard deviation of the point spread
  float noise_grey = 0.7f;  // standard deviation at middle grey, after everything, grey levels
  float vignetting = 0.2f;  // loss in the corners
  float gamma = 2.2f;
  float contrast = 0.0f;     // strength of an S curve
  float black_level = 0.0f;  // grey levels
  float sharpening = 0.0f;
  bool mosaic = true;  // Bayer pattern and demosaicing
  float saturation = 1.0f;
  int jpeg_quality = 92;  // 0: never compressed
};

struct DepthSensor {
  float baseline_m = 0.075f;
  float focal_px = 575.0f;
  float step_px = 0.125f;        // of disparity
  int window_px = 3;             // radius of the windows that are matched: smooths relief
  float noise_px = 0.01f;        // of disparity, standard deviation pixel by pixel
  float blotch_px = 0.035f;      // of disparity, standard deviation of patches
  float blotch_size_px = 4.0f;   // of patches
  float band_px = 0.03f;         // of disparity, amplitude of steps between bands of columns
  float band_width_px = 106.0f;  // a sixth of the picture in Kinects
  float warp_m = 0.004f;         // low-order distortion at the corners
  float warp[5] = {};
  float shift_x_px = 0.0f, shift_y_px = 0.0f;  // error of the registration
  float edge_loss = 0.5f;                      // chance to lose a pixel at an edge
  float steep_loss = 0.3f;                     // cosine below which slopes get lost
  int fill_px = 0;                             // holes up to this width are filled in
  int border_px[4] = {};         // missing at the left, top, right and bottom of a registered frame
  float projector_sign = -1.0f;  // side of the projector
};

struct Placement {  // of an object: turn about z, then move
  float sine = 0.0f, cosine = 1.0f;
  Vec2 offset = Vec2::Zero();
  Vec3 apply(const Vec3& p) const {
    return {cosine * p.x() - sine * p.y() + offset.x(), sine * p.x() + cosine * p.y() + offset.y(),
            p.z()};
  }
};

/// Everything drawn for one view of one or two garments.
struct ViewRecipe {
  rgbd::CameraModel camera;
  CameraPose pose;
  bool mirrored = false;
  Table table;
  Lighting lighting;
  std::vector<Placement> placements;  // by object
  std::vector<Fabric> fabrics;        // by object
  ColourSensor colour;
  DepthSensor depth;
  std::uint64_t sensor_seed = 0;
  float contact = 0.0f;  // depth of the shadows where layers meet, 0 to 1
};

/// Sensors as different as those of the real scans.
void draw_sensors(Random& random, ColourSensor& colour, DepthSensor& depth);

/// objects: one or two garments, the first the one the scene is about. held_out: fabrics reserved
/// for testing.
ViewRecipe draw_view(Random& random, const std::vector<const Simulation*>& objects, bool held_out);

}  // namespace weft::synth
