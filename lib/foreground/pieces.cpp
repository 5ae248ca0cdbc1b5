#include "foreground/pieces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <deque>
#include <vector>

#include "base/error.hpp"

namespace weft::foreground {
namespace {

const std::array<cv::Point, 4> kNeighbours{{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

bool inside(const cv::Mat& image, const cv::Point& p) {
  return p.x >= 0 && p.y >= 0 && p.x < image.cols && p.y < image.rows;
}

/// Every pixel of `mask` whose value is 0 takes that of the nearest along the mask.
template <class T>
void grow(const cv::Mat& mask, cv::Mat_<T> values) {
  std::deque<cv::Point> front;
  for (int y = 0; y < mask.rows; ++y)
    for (int x = 0; x < mask.cols; ++x)
      if (mask.at<std::uint8_t>(y, x) != 0 && values(y, x) > 0) front.emplace_back(x, y);
  for (; !front.empty(); front.pop_front()) {
    for (const auto& step : kNeighbours) {
      const cv::Point to = front.front() + step;
      if (!inside(mask, to) || mask.at<std::uint8_t>(to) == 0 || values(to) > 0) continue;
      values(to) = values(front.front());
      front.push_back(to);
    }
  }
}

/// Labels from `first` on what hangs together in `mask` and has no label; how many.
int label_components(const cv::Mat& mask, int first, cv::Mat& labels) {
  int count = 0;
  std::vector<cv::Point> stack;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      if (mask.at<std::uint8_t>(y, x) == 0 || labels.at<int>(y, x) > 0) continue;
      const int label = first + count++;
      labels.at<int>(y, x) = label;
      stack.assign(1, {x, y});
      while (!stack.empty()) {
        const cv::Point from = stack.back();
        stack.pop_back();
        for (const auto& step : kNeighbours) {
          const cv::Point to = from + step;
          if (!inside(mask, to) || mask.at<std::uint8_t>(to) == 0 || labels.at<int>(to) > 0)
            continue;
          labels.at<int>(to) = label;
          stack.push_back(to);
        }
      }
    }
  }
  return count;
}

/// Steps to the nearest pixel that is 0, through neighbours; beyond the border is none.
cv::Mat steps_inside(const cv::Mat& mask) {
  cv::Mat steps(mask.size(), CV_32SC1, cv::Scalar(1 << 20));
  std::deque<cv::Point> front;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      if (mask.at<std::uint8_t>(y, x) != 0) continue;
      steps.at<int>(y, x) = 0;
      front.emplace_back(x, y);
    }
  }
  for (; !front.empty(); front.pop_front()) {
    const int next = steps.at<int>(front.front()) + 1;
    for (const auto& step : kNeighbours) {
      const cv::Point to = front.front() + step;
      if (!inside(mask, to) || steps.at<int>(to) <= next) continue;
      steps.at<int>(to) = next;
      front.push_back(to);
    }
  }
  return steps;
}

/// Half the largest side, in camera coordinates, of each label's points.
std::vector<double> extents_m(const rgbd::RgbdFrame& frame, const cv::Mat& labels, int count) {
  std::vector<Eigen::AlignedBox3d> boxes(static_cast<std::size_t>(count) + 1);
  for (int y = 0; y < labels.rows; ++y) {
    for (int x = 0; x < labels.cols; ++x) {
      const int label = labels.at<int>(y, x);
      const double z_m = frame.depth_m(x, y);
      if (label > 0 && z_m > 0.0)
        boxes[static_cast<std::size_t>(label)].extend(frame.camera.unproject(x, y, z_m));
    }
  }
  std::vector<double> out;
  for (const auto& box : boxes) out.push_back(box.isEmpty() ? 0.0 : 0.5 * box.sizes().maxCoeff());
  return out;
}

}  // namespace

Pieces part_mask(const rgbd::RgbdFrame& frame, const cv::Mat& mask, const PieceOptions& options) {
  options.validate();
  if (mask.type() != CV_8UC1 || mask.size() != frame.depth.size())
    throw Error("pieces of a mask: it is not of 8 bits, or not of the depth image's size");
  // Between a near and a far garment there often is a strip without depth: the step lies in it.
  cv::Mat_<std::uint16_t> depth = frame.depth.clone();
  grow(mask, depth);
  const auto parted = [&](const cv::Point& a, const cv::Point& b) {
    const double z_a = depth(a) * frame.depth_unit_m, z_b = depth(b) * frame.depth_unit_m;
    const double far_m = std::max(z_a, z_b);
    // Of a difference, so sqrt(2) times; 3 * 1.414.
    return std::abs(z_a - z_b) >
           std::max(options.step_m, 4.24 * options.inverse_depth_per_m * far_m * far_m);
  };
  // What lies whole: no step in depth to a neighbour.
  cv::Mat whole = mask != 0;
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      for (const cv::Point to : {cv::Point(x + 1, y), cv::Point(x, y + 1)}) {
        if (!inside(mask, to) || mask.at<std::uint8_t>(y, x) == 0 ||
            mask.at<std::uint8_t>(to) == 0 || !parted({x, y}, to))
          continue;
        whole.at<std::uint8_t>(y, x) = whole.at<std::uint8_t>(to) = 0;
      }
    }
  }
  // The middles of what is wider than a neck.
  const cv::Mat steps = steps_inside(whole);
  cv::Mat middle = whole.clone();
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      if (whole.at<std::uint8_t>(y, x) == 0) continue;
      const double z_m = depth(y, x) * frame.depth_unit_m;
      if (2.0 * steps.at<int>(y, x) * z_m / frame.camera.fx <= options.neck_m)
        middle.at<std::uint8_t>(y, x) = 0;
    }
  }
  cv::Mat labels = cv::Mat::zeros(mask.size(), CV_32SC1);
  int count = label_components(middle, 1, labels);
  // A middle is smaller than its garment by half a neck all round.
  const auto sizes = extents_m(frame, labels, count);
  for (auto& label : cv::Mat_<int>(labels))
    if (sizes[static_cast<std::size_t>(label)] + 0.5 * options.neck_m < options.least_extent_m)
      label = 0;
  grow<int>(whole, labels);
  grow<int>(mask, labels);
  count += label_components(mask, count + 1, labels);  // narrow or small throughout

  Pieces out{labels, 0};
  std::vector<int> order(static_cast<std::size_t>(count) + 1, 0);
  for (auto& label : cv::Mat_<int>(labels)) {
    if (label == 0) continue;
    int& place = order[static_cast<std::size_t>(label)];
    if (place == 0) place = ++out.count;
    label = place;
  }
  return out;
}

}  // namespace weft::foreground
