#include "evaluation/part_picture.hpp"

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>

#include "evaluation/part_metrics.hpp"

namespace weft::evaluation {
namespace {

void draw_polygon(cv::Mat& picture, const std::vector<cv::Point>& points, const cv::Scalar& colour,
                  int thickness) {
  cv::polylines(picture, std::vector<std::vector<cv::Point>>{points}, true, colour, thickness,
                cv::LINE_AA);
}

void write(cv::Mat& picture, const std::string& text, const cv::Point& at,
           const cv::Scalar& colour) {
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.4, {0, 0, 0}, 3, cv::LINE_AA);
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv::LINE_AA);
}

}  // namespace

cv::Mat draw_parts(const cv::Mat& colour, const std::vector<dataset::PartPolygon>& truth,
                   const std::vector<detector::Detection>& detections, double min_probability) {
  cv::Mat picture = colour.clone();
  for (const auto& polygon : truth) {
    std::vector<cv::Point> points(polygon.points.begin(), polygon.points.end());
    draw_polygon(picture, points,
                 polygon.ignore ? cv::Scalar(160, 160, 160) : cv::Scalar(0, 220, 0), 2);
  }
  std::map<std::string, std::vector<const detector::Detection*>> by_part;
  for (const auto& d : detections) by_part[d.part].push_back(&d);
  for (auto& of_part : by_part) {
    const std::string& part = of_part.first;
    auto& found = of_part.second;
    std::stable_sort(found.begin(), found.end(),
                     [](const auto* a, const auto* b) { return a->probability > b->probability; });
    const bool there = std::any_of(truth.begin(), truth.end(), [&](const auto& polygon) {
      return polygon.part == part && !polygon.ignore;
    });
    for (std::size_t rank = found.size(); rank-- > 0;) {
      const auto& d = *found[rank];
      if (!(there && rank < 3) && d.probability < min_probability) continue;
      const auto red = cv::Scalar(0, 0, 255.0 / (1.0 + static_cast<double>(rank)));
      const auto tint = there ? red : cv::Scalar(255, 128, 0);
      std::vector<cv::Point> corners;
      for (const auto& c : d.corners_sensor_px) {
        corners.emplace_back(cvRound(c.x()), cvRound(c.y()));
      }
      draw_polygon(picture, corners, tint, rank == 0 ? 2 : 1);
      const cv::Point centre(cvRound(d.centre_sensor_px.x()), cvRound(d.centre_sensor_px.y()));
      cv::circle(picture, centre, 3, tint, cv::FILLED, cv::LINE_AA);
      const bool right = std::any_of(truth.begin(), truth.end(), [&](const auto& polygon) {
        return polygon.part == part && !polygon.ignore &&
               inside(polygon.points, d.centre_sensor_px.x(), d.centre_sensor_px.y());
      });
      if (right) cv::circle(picture, centre, 7, {0, 220, 0}, 2, cv::LINE_AA);
      write(picture, part + " " + std::to_string(cvRound(d.probability * 100)),
            corners.front() + cv::Point(2, 12), there ? cv::Scalar(200, 200, 255) : tint);
    }
  }
  return picture;
}

}  // namespace weft::evaluation
