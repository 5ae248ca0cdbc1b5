#include "messages/grasp.hpp"

#include <algorithm>
#include <cmath>

#include "stage/stage.hpp"

namespace weft::messages {

namespace {

void copy(const Eigen::Vector3d& from, double* to) { std::copy_n(from.data(), 3, to); }

}  // namespace

void to_message(const std::vector<detector::Grasp>& grasps,
                const std::optional<Eigen::Isometry3d>& T_base_camera, grasps_t& message) {
  message.grasps.clear();
  for (const detector::Grasp& grasp : grasps) {
    grasp_t out;
    out.part = grasp.part;
    out.detection = grasp.detection;
    out.score = grasp.score;
    out.pixel[0] = grasp.pixel.x();
    out.pixel[1] = grasp.pixel.y();
    copy(grasp.point_camera_m, out.point_camera_m);
    copy(grasp.approach_camera, out.approach_camera);
    out.has_base = T_base_camera ? 1 : 0;
    Eigen::Vector3d point_base_m = Eigen::Vector3d::Zero(), approach_base = point_base_m;
    if (T_base_camera) {
      point_base_m = *T_base_camera * grasp.point_camera_m;
      approach_base = T_base_camera->linear() * grasp.approach_camera;
    }
    copy(point_base_m, out.point_base_m);
    copy(approach_base, out.approach_base);
    message.grasps.push_back(std::move(out));
  }
  message.grasp_count = static_cast<std::int32_t>(message.grasps.size());
}

std::vector<detector::Grasp> from_message(const grasps_t& message) {
  std::vector<detector::Grasp> grasps;
  for (const grasp_t& in : message.grasps) {
    detector::Grasp grasp;
    grasp.part = in.part;
    grasp.detection = in.detection;
    grasp.score = in.score;
    grasp.pixel = Eigen::Vector2d(in.pixel[0], in.pixel[1]);
    grasp.point_camera_m = Eigen::Map<const Eigen::Vector3d>(in.point_camera_m);
    grasp.approach_camera = Eigen::Map<const Eigen::Vector3d>(in.approach_camera);
    if (grasp.detection < 0 || !(grasp.score >= 0.0 && grasp.score <= 1.0) ||
        !grasp.pixel.allFinite() || !grasp.point_camera_m.allFinite() ||
        !(std::abs(grasp.approach_camera.norm() - 1.0) <= 1e-6))
      throw stage::InvalidInput("GRASPS: grasp " + std::to_string(grasps.size()) +
                                " holds an impossible index, score, point or approach");
    grasps.push_back(std::move(grasp));
  }
  return grasps;
}

}  // namespace weft::messages
