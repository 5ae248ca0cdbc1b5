#include "rgbd/camera_model.hpp"

#include <cmath>

#include "base/error.hpp"

namespace weft::rgbd {

Eigen::Matrix3d CameraModel::matrix() const {
  Eigen::Matrix3d k = Eigen::Matrix3d::Identity();
  k(0, 0) = fx;
  k(1, 1) = fy;
  k(0, 2) = cx;
  k(1, 2) = cy;
  return k;
}

void CameraModel::validate(const std::string& where) const {
  if (width < 1 || height < 1 || width > 8192 || height > 8192) {
    throw Error(where + ": image size " + std::to_string(width) + "x" + std::to_string(height) +
                " is not within 1x1 to 8192x8192 px");
  }
  if (!(fx > 0.0 && fx < 1e5 && fy > 0.0 && fy < 1e5)) {
    throw Error(where + ": focal lengths fx=" + std::to_string(fx) + " fy=" + std::to_string(fy) +
                " must be positive and below 100000 px");
  }
  if (!(std::abs(cx) <= 3.0 * width && std::abs(cy) <= 3.0 * height)) {
    throw Error(where + ": principal point cx=" + std::to_string(cx) + " cy=" + std::to_string(cy) +
                " is not near the image");
  }
}

}  // namespace weft::rgbd
