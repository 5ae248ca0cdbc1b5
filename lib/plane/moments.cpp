#include "plane/moments.hpp"

#include <algorithm>

namespace weft::plane {

Moments& Moments::operator+=(const Moments& o) {
  n += o.n;
  x += o.x;
  y += o.y;
  xx += o.xx;
  xy += o.xy;
  yy += o.yy;
  d += o.d;
  xd += o.xd;
  yd += o.yd;
  dd += o.dd;
  return *this;
}

std::optional<InversePlane> Moments::fit() const {
  if (n < 3.0) return std::nullopt;
  const double mx = x / n, my = y / n, md = d / n;
  const double cxx = xx - x * mx, cxy = xy - x * my, cyy = yy - y * my;
  const double cxd = xd - x * md, cyd = yd - y * md;
  const double determinant = cxx * cyy - cxy * cxy;
  // 1e-9: what is left of pixels on a line by rounding.
  if (!(determinant > 1e-9 * cxx * cyy)) return std::nullopt;
  const double a = (cxd * cyy - cyd * cxy) / determinant;
  const double b = (cyd * cxx - cxd * cxy) / determinant;
  return InversePlane(a, b, md - a * mx - b * my);
}

double Moments::mean_square(const InversePlane& plane) const {
  const double a = plane.x(), b = plane.y();
  const double mx = x / n, my = y / n, md = d / n;
  const double cxx = xx / n - mx * mx, cxy = xy / n - mx * my, cyy = yy / n - my * my;
  const double cxd = xd / n - mx * md, cyd = yd / n - my * md, cdd = dd / n - md * md;
  const double mean = md - a * mx - b * my - plane.z();
  return std::max(0.0,
                  cdd - 2.0 * (a * cxd + b * cyd) + a * a * cxx + 2.0 * a * b * cxy + b * b * cyy) +
         mean * mean;
}

double Moments::mean_square_m(const InversePlane& plane) const {
  // The point at depth z lies z (d - p . (x, y, 1)) / |p| before the plane.
  return mean_square(plane) * (n / d) * (n / d) / plane.squaredNorm();
}

Eigen::Matrix3d Moments::information() const {
  Eigen::Matrix3d m;
  m << xx, xy, x, xy, yy, y, x, y, n;
  return m;
}

Eigen::Vector3d Moments::centre(const InversePlane& plane) const {
  const Eigen::Vector3d ray(x / n, y / n, 1.0);
  return ray / plane.dot(ray);
}

rgbd::Plane hesse(const InversePlane& plane) {
  rgbd::Plane out;
  const double norm = plane.norm();
  out.normal = -plane / norm;
  out.distance_m = -1.0 / norm;
  return out;
}

}  // namespace weft::plane
