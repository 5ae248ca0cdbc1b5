#pragma once

#include <Eigen/Core>

#include "base/options.hpp"
#include "rgbd/camera_model.hpp"
#include "slam/rigid3d.hpp"
#include "slam/tangent.hpp"

/// What the optimisations of lib/slam take in: plain data, with indices into the caller's lists.
/// Sources: garment-slam.txt 3.4 and 3.5; the plane factor's transform there has a wrong sign.
namespace weft::slam {

using rgbd::CameraModel;

/// A landmark seen at a pixel, with the depth measured there if there was one.
struct PointObservation {
  int camera = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // px
  double sigma_px = 1.0;                            // standard deviation of both coordinates, > 0
  double depth_m = 0.0;                             // along the optical axis; 0: not measured
  double sigma_depth_m = 0.0;  // its standard deviation, > 0 where depth_m is measured

  int dimension() const { return depth_m > 0.0 ? 3 : 2; }
};

/// A plane seen by a camera: normal_camera . x = distance_m. Which way the normal points does not
/// matter: the factor takes the side that fits the landmark's.
struct PlaneObservation {
  int camera = 0;
  int plane = 0;
  Eigen::Vector3d normal_camera = -Eigen::Vector3d::UnitZ();  // of unit length
  double distance_m = 0.0;
  /// Of (tilt about e0 [rad], tilt about e1 [rad], distance [m]) with e0, e1 =
  /// plane::tangent_basis(normal_camera), as plane::PlaneSegment has it; the floors of PlaneNoise
  /// are applied here.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// An object's pose as measured from a camera.
struct ObjectObservation {
  int camera = 0;
  int object = 0;
  Rigid3d T_camera_object;
  Matrix6d information = Matrix6d::Identity();  // of (rotation [rad], translation [m])
};

/// A plane of the map: normal_world . x = distance_m, the normal of unit length.
struct PlaneState {
  Eigen::Vector3d normal_world = Eigen::Vector3d::UnitZ();
  double distance_m = 0.0;
  bool fixed = false;
};

/// What a depth camera adds to the covariance a plane's own scatter tells: warps that no number of
/// points averages away.
struct PlaneNoise {
  double floor_tilt_deg = 0.5;
  double floor_distance_m = 0.01;

  void visit(OptionVisitor& v) {
    v.field("floor_tilt_deg", floor_tilt_deg, {0.0, 10.0}, "deg",
            "least standard deviation of a measured plane's tilt");
    v.field("floor_distance_m", floor_distance_m, {0.0, 0.2}, "m",
            "least standard deviation of a measured plane's distance, at the place where its tilt "
            "does not change it: its centroid");
  }
};

/// The covariance with both floors. The distance from the origin also varies with the tilt, by the
/// lever of the plane's centroid; the lever is kept, so a raised tilt raises it as well. Throws
/// Error when the matrix is not symmetric, finite and positive semidefinite.
Eigen::Matrix3d with_floors(const Eigen::Matrix3d& covariance, const PlaneNoise& noise);

}  // namespace weft::slam
