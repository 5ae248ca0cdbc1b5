#include "messages/detections.hpp"

#include <algorithm>
#include <cmath>

#include "messages/view.hpp"
#include "stage/stage.hpp"

namespace weft::messages {

void to_message(const rgbd::View& view, const std::vector<detector::Detection>& detections,
                std::uint64_t model_hash, part_detections_t& message) {
  message.model_hash = static_cast<std::int64_t>(model_hash);
  message.view = to_message(view);
  message.detections.clear();
  for (const auto& d : detections) {
    part_detection_t m;
    m.part = d.part;
    m.probability = d.probability;
    m.x_view = d.box_view.x;
    m.y_view = d.box_view.y;
    m.width_view = d.box_view.width;
    m.height_view = d.box_view.height;
    for (int i = 0; i < 2; ++i) m.centre_sensor[i] = d.centre_sensor_px[i];
    for (std::size_t corner = 0; corner < 4; ++corner) {
      for (int i = 0; i < 2; ++i) m.corners_sensor[corner][i] = d.corners_sensor_px[corner][i];
    }
    message.detections.push_back(std::move(m));
  }
  message.detection_count = static_cast<std::int32_t>(message.detections.size());
}

DetectionsContent from_message(const part_detections_t& message) {
  DetectionsContent content;
  content.view = from_message(message.view, "PART_DETECTIONS");
  for (const auto& m : message.detections) {
    const auto fail = [&](const std::string& what) {
      throw stage::InvalidInput("PART_DETECTIONS: detection " +
                                std::to_string(content.detections.size()) + ": " + what);
    };
    detector::Detection d;
    if (std::find(detector::kParts.begin(), detector::kParts.end(), m.part) ==
        detector::kParts.end()) {
      fail("unknown part '" + m.part.substr(0, 64) + "'");
    }
    d.part = m.part;
    d.probability = m.probability;
    if (!(d.probability >= 0.0 && d.probability <= 1.0)) fail("the probability is not in 0 to 1");
    d.box_view = {m.x_view, m.y_view, m.width_view, m.height_view};
    bool finite = std::isfinite(m.x_view) && std::isfinite(m.y_view) &&
                  std::isfinite(m.width_view) && std::isfinite(m.height_view);
    for (int i = 0; i < 2; ++i) {
      d.centre_sensor_px[i] = m.centre_sensor[i];
      finite = finite && std::isfinite(m.centre_sensor[i]);
      for (std::size_t corner = 0; corner < 4; ++corner) {
        d.corners_sensor_px[corner][i] = m.corners_sensor[corner][i];
        finite = finite && std::isfinite(m.corners_sensor[corner][i]);
      }
    }
    if (!finite || !(m.width_view > 0.0) || !(m.height_view > 0.0)) {
      fail("the box is not finite or has no area");
    }
    content.detections.push_back(std::move(d));
  }
  return content;
}

}  // namespace weft::messages
