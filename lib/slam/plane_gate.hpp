#pragma once

#include "rgbd/frame.hpp"
#include "slam/observations.hpp"

namespace weft::slam {

/// The plane in the camera's frame: n_c = R n_w, d_c = d_w + t . n_c (normal . x = distance). Of
/// the two signs the one whose normal points to the camera (distance <= 0).
rgbd::Plane in_camera(const PlaneState& plane, const Rigid3d& T_camera_world);
/// The plane in the world's frame; the sign is kept.
PlaneState in_world(const rgbd::Plane& plane_camera, const Rigid3d& T_camera_world);

/// Covariance of (tilt, tilt, distance) in plane::tangent_basis of the plane's normal in the world,
/// from that in the camera's frame (floors are the caller's matter) and that of the pose.
Eigen::Matrix3d covariance_in_world(const rgbd::Plane& plane_camera,
                                    const Eigen::Matrix3d& covariance_camera,
                                    const Rigid3d& T_camera_world, const Matrix6d& pose_covariance);

/// How well an observation agrees with a plane of the map: the squared Mahalanobis distance of
/// (tilt, tilt, distance) under the covariances of the observation (with the floors of
/// PlaneNoise), of the map's plane (in plane::tangent_basis(normal_world)) and of the camera's
/// pose. To be compared with chi_squared_95(3). Two planes are taken to face the same way.
double plane_distance(const PlaneState& plane, const Eigen::Matrix3d& plane_covariance,
                      const PlaneObservation& observation, const Rigid3d& T_camera_world,
                      const Matrix6d& pose_covariance, const PlaneNoise& noise = {});

}  // namespace weft::slam
