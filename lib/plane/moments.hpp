#pragma once

#include <Eigen/Core>
#include <optional>

#include "rgbd/frame.hpp"

namespace weft::plane {

/// A plane as a depth camera sees it: inverse depth = a x + b y + c with (x, y) the pixel in units
/// of the focal length from the principal point. With p = (a, b, c), p . point = 1.
using InversePlane = Eigen::Vector3d;  // 1/m

/// Sums over pixels of their place (x, y) and inverse depth d (1/m): all that least squares of
/// inverse depth need. Those of a region are the sums of its cells'.
struct Moments {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, d = 0, xd = 0, yd = 0, dd = 0;

  Moments& operator+=(const Moments& o);
  /// The least squares plane; none when there are too few pixels or they lie on a line.
  std::optional<InversePlane> fit() const;
  /// Mean square of d - (a x + b y + c), in 1/m^2.
  double mean_square(const InversePlane& plane) const;
  /// Mean square in metres of the points' distance from the plane, for pixels of about one depth.
  double mean_square_m(const InversePlane& plane) const;
  /// Sum of (x, y, 1) (x, y, 1)^T: the information about (a, b, c), for noise of 1 / m.
  Eigen::Matrix3d information() const;
  /// The point of the plane in the middle of the pixels.
  Eigen::Vector3d centre(const InversePlane& plane) const;
};

rgbd::Plane hesse(const InversePlane& plane);

}  // namespace weft::plane
