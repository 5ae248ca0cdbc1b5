#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "slam/map.hpp"

/// Garments in the map: what single pictures say of them and their parts, carried into the world
/// and merged over key frames. After garment-slam.txt 3.5.1: assignment of least total cost, not
/// nearest-first, and five consecutive views to appear. The paper's views are key frames; a camera
/// that stays over a table makes none, so further frames may be looked at in between.
namespace weft::slam {

/// A garment part, or a place to take hold of one, as seen from a camera.
struct PartSighting {
  std::string part;                                           // "polo collar"
  double probability = 0.0;                                   // that it is there, in [0, 1]
  Eigen::Vector3d position_camera = Eigen::Vector3d::Zero();  // on the cloth, m
  Eigen::Matrix3d covariance_camera = Eigen::Matrix3d::Identity();
  bool has_grasp = false;
  double grasp_score = 0.0;                                    // in [0, 1]
  Eigen::Vector3d approach_camera = Eigen::Vector3d::UnitZ();  // from the gripper into the cloth
};

/// A garment as seen from a camera: an instance of a segmentation, or the one that foreground
/// shows.
struct GarmentSighting {
  Eigen::Vector3d position_camera = Eigen::Vector3d::Zero();  // middle of its visible points, m
  Eigen::Matrix3d covariance_camera = Eigen::Matrix3d::Identity();
  double extent_m = 0.3;  // half its largest size
  std::vector<PartSighting> parts;
};

/// Of a point whose pixel and depth are measured with these standard deviations. slope_m_px: how
/// depth changes along u and v there, so that another pixel is another depth.
Eigen::Matrix3d point_covariance(const rgbd::CameraModel& camera,
                                 const Eigen::Vector3d& point_camera, double sigma_px,
                                 double sigma_depth_m,
                                 const Eigen::Vector2d& slope_m_px = Eigen::Vector2d::Zero());

struct GarmentMapOptions {
  double centre_sigma_m = 0.05;
  double part_sigma_m = 0.02;
  double part_bias_m = 0.025;
  double max_chi_squared = 16.27;
  bool needs_part = true;
  int views_to_appear = 5;
  int views_to_disappear = 5;
  double memory = 0.8;
  double min_probability = 0.05;
  double max_range_m = 3.0;
  double margin_px = 40.0;
  double max_height_m = 0.3;
  double plane_reach_m = 0.3;

  void visit(OptionVisitor& v) {
    v.field("centre_sigma_m", centre_sigma_m, {1e-3, 10.0}, "m",
            "by which the middle of what is visible of a garment differs from view to view");
    v.field("part_sigma_m", part_sigma_m, {1e-4, 10.0}, "m",
            "likewise for a part: its detector's grid and its size");
    v.field("part_bias_m", part_bias_m, {0.0, 10.0}, "m",
            "by which all views of a part err alike, so that more of them do not help: the middle "
            "of a detection is not that of the part");
    v.field("max_chi_squared", max_chi_squared, {0.1, 1e6}, "",
            "up to which a sighting may be of a known garment or part; 16.27: 99.9 % of three "
            "degrees of freedom");
    v.field("needs_part", needs_part,
            "a garment is new only where a part of it was detected: what foreground alone shows "
            "may be furniture");
    v.field("views_to_appear", views_to_appear, {1, 1000}, "",
            "consecutive views that see a garment before it is in the map "
            "(garment-slam.txt 3.5.1: 5)");
    v.field("views_to_disappear", views_to_disappear, {1, 1000}, "",
            "consecutive views that should see a garment, and do not, before it is gone");
    v.field("memory", memory, {0.0, 0.99}, "",
            "what a part's probability keeps of its former value with each view of its garment");
    v.field("min_probability", min_probability, {0.0, 1.0}, "",
            "a part below this goes when a view of its garment does not show it");
    v.field("max_range_m", max_range_m, {0.1, 100.0}, "m", "farther garments need not be seen");
    v.field("margin_px", margin_px, {0.0, 10000.0}, "px",
            "nor those whose middle is projected this near the picture's border");
    v.field("max_height_m", max_height_m, {0.0, 10.0}, "m",
            "a garment's middle is at most so far above the plane it lies on");
    v.field("plane_reach_m", plane_reach_m, {0.0, 10.0}, "m",
            "and that plane was seen within this distance below it");
  }
  void validate() const { validate_fields(*this, "GarmentMapOptions"); }
};

struct GarmentPart {
  std::string part;
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // world
  double probability = 0.0;  // mean over the views, the latest weighing most
  int sightings = 0;
  bool has_grasp = false;
  double grasp_score = 0.0;  // of the last grasp seen
  Eigen::Vector3d approach_world = Eigen::Vector3d::UnitZ();
  Eigen::Vector3d position_anchor = Eigen::Vector3d::Zero();  // in the anchor's camera
};

struct Garment {
  Id id = kNoId;
  bool in_map = false;  // false: a candidate, not to be relied on
  Eigen::Vector3d position_world = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // world
  double extent_m = 0.0;
  Id supporting_plane = kNoId;  // of the map
  std::vector<GarmentPart> parts;
  int sightings = 0;
  int consecutive = 0;  // views in a row that saw it
  int missed = 0;       // that should have and did not
  Id anchor = kNoId;    // key frame that saw it last: it follows when the map moves that
  Eigen::Vector3d position_anchor = Eigen::Vector3d::Zero();  // in the anchor's camera
};

/// Where one looks from: a key frame of the map, or a pose beside one, whose camera it has.
struct GarmentView {
  Id key_frame = kNoId;
  Rigid3d T_camera_key_frame = {};
};

struct SavedGarments {
  std::vector<Garment> garments;
  Id next_id = 0;
};
/// Throws Error on values no GarmentMap holds: positions that are not finite, covariances that are
/// not positive definite, shares outside 0 to 1, ids that do not ascend or are not below the next.
void check_garments(const SavedGarments& saved);

class GarmentMap {
 public:
  explicit GarmentMap(const GarmentMapOptions& options);
  /// Goes on with saved garments. Throws Error as check_garments.
  GarmentMap(const GarmentMapOptions& options, SavedGarments saved);

  /// What was seen from somewhere; empty: one looked and saw none. Throws Error, and changes
  /// nothing, when the view's key frame is not in the map or a value cannot be.
  void add(const Map& map, const GarmentView& view, std::span<const GarmentSighting> sightings);
  /// Moves all with their key frames, after the map has changed.
  void follow(const Map& map);

  /// All, candidates too, by id.
  const std::vector<Garment>& garments() const { return garments_; }
  SavedGarments saved() const { return {garments_, next_id_}; }

 private:
  struct SeenInWorld;
  void merge(Garment& garment, const SeenInWorld& seen) const;
  void merge_parts(Garment& garment, const SeenInWorld& seen) const;
  bool should_be_seen(const Garment& garment, const rgbd::CameraModel& camera,
                      const Rigid3d& T_camera_world) const;
  Id supporting_plane(const Map& map, const Eigen::Vector3d& position_world) const;

  GarmentMapOptions options_;
  std::vector<Garment> garments_;
  Id next_id_ = 0;
};

}  // namespace weft::slam
