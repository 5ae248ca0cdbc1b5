#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "synth/view_recipe.hpp"

namespace weft::synth {

/// A simulated garment made ready for rendering: what does not change from view to view.
struct Garment {
  Simulation simulation;
  std::vector<PanelMap> maps;
  Surface coarse;                           // carries the light
  Surface fine;                             // one subdivision finer
  std::vector<std::array<int, 2>> parents;  // of the fine vertices
  std::vector<SkyMask> blocked;             // by coarse vertex
};

Garment prepare_garment(Simulation simulation);

/// Noise-free images of a view, as an ideal camera sees it; CV_32FC1 unless said otherwise.
struct IdealImages {
  cv::Mat radiance;  // CV_32FC3, linear RGB
  cv::Mat depth_m;   // along the optical axis
  cv::Mat cosine;    // between the line of sight and the surface normal
  cv::Mat object;    // CV_8UC1, 0 = table or floor, 1 + index of the object otherwise
  cv::Mat parts;     // CV_32SC1, bits of the part instances of that object
  cv::Mat inside;    // CV_8UC1, 255 = inner face
  cv::Mat shadow;    // CV_8UC1, 255 = the depth sensor's projector does not reach it
};

/// Surface of a part instance, m^2, as the camera sees it.
struct PartVisibility {
  double total = 0.0;
  double seen_outside = 0.0, seen_inside = 0.0;  // in the frame
  double seen_beyond_frame = 0.0;                // would be seen by a larger sensor
};

class ViewScene {
 public:
  /// The garments and the recipe must outlive the scene.
  ViewScene(const std::vector<const Garment*>& garments, const ViewRecipe& recipe);
  ~ViewScene();

  /// samples: colour samples a pixel are samples x samples. Mirrored if the recipe says so.
  IdealImages render(int samples) const;
  /// Of an object's part instances.
  std::vector<PartVisibility> part_visibility(std::size_t object) const;

 private:
  Vec3 ray(double u_px, double v_px) const;
  float table_distance(const Vec3& direction, bool& floor) const;
  Vec3 shade_table(const Vec3& point, bool floor) const;

  const std::vector<const Garment*>& garments_;
  const ViewRecipe& recipe_;
  std::vector<Surface> surfaces_;               // fine, placed in the world
  std::vector<std::vector<Irradiance>> light_;  // by object and fine vertex
  RayScene scene_;
  cv::Mat table_light_;  // CV_32FC3, irradiance over pi of the grid's nodes
  cv::Mat table_gloss_;  // CV_32FC3
  Vec2 grid_origin_ = Vec2::Zero();
};

}  // namespace weft::synth
