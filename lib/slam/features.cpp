#include "slam/features.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"

namespace weft::slam {
namespace {

constexpr int kPatchRadius = 15;  // of the orientation
constexpr int kBorder = 20;       // px of a level within which a turned patch would leave the image

// Half width of each row of the patch's disc.
std::array<int, kPatchRadius + 1> disc() {
  std::array<int, kPatchRadius + 1> half{};
  for (int v = 0; v <= kPatchRadius; ++v)
    while ((half[v] + 1) * (half[v] + 1) + v * v <= kPatchRadius * kPatchRadius) ++half[v];
  return half;
}

// Direction from the patch's centre to its centroid of intensity, degrees.
float orientation(const cv::Mat& image, int u, int v) {
  static const auto half = disc();
  int m10 = 0, m01 = 0;
  for (int y = -kPatchRadius; y <= kPatchRadius; ++y) {
    const std::uint8_t* row = image.ptr<std::uint8_t>(v + y) + u;
    const int reach = half[std::abs(y)];
    int sum = 0;
    for (int x = -reach; x <= reach; ++x) {
      m10 += x * row[x];
      sum += row[x];
    }
    m01 += y * sum;
  }
  return cv::fastAtan2(static_cast<float>(m01), static_cast<float>(m10));
}

// Of the corners found with the low threshold: those of full contrast, and the others in cells that
// have none; then the best `wanted`, the best of each cell first.
std::vector<cv::KeyPoint> spread(std::vector<cv::KeyPoint> corners, cv::Size size, int wanted,
                                 const FeatureOptions& options) {
  const int columns = (size.width + options.cell_px - 1) / options.cell_px;
  const int rows = (size.height + options.cell_px - 1) / options.cell_px;
  const auto cell_of = [&](const cv::KeyPoint& corner) {
    return static_cast<int>(corner.pt.y) / options.cell_px * columns +
           static_cast<int>(corner.pt.x) / options.cell_px;
  };
  std::vector<std::uint8_t> full(static_cast<std::size_t>(columns * rows), 0);
  const auto contrast = static_cast<float>(options.fast_threshold);
  for (const auto& corner : corners)
    if (corner.response >= contrast) full[static_cast<std::size_t>(cell_of(corner))] = 1;
  std::erase_if(corners, [&](const cv::KeyPoint& corner) {
    return corner.response < contrast && full[static_cast<std::size_t>(cell_of(corner))] != 0;
  });
  const auto before = [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    if (a.response != b.response) return a.response > b.response;
    return a.pt.y != b.pt.y ? a.pt.y < b.pt.y : a.pt.x < b.pt.x;
  };
  std::sort(corners.begin(), corners.end(), before);
  std::vector<int> taken(full.size(), 0);
  for (auto& corner : corners) corner.class_id = taken[static_cast<std::size_t>(cell_of(corner))]++;
  std::stable_sort(
      corners.begin(), corners.end(),
      [](const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.class_id < b.class_id; });
  if (static_cast<int>(corners.size()) > wanted)
    corners.resize(static_cast<std::size_t>(std::max(wanted, 0)));
  return corners;
}

float depth_at(const rgbd::RgbdFrame& frame, float u_px, float v_px,
               const FeatureOptions& options) {
  const int u = std::clamp(static_cast<int>(std::lround(u_px)), 1, frame.depth.cols - 2);
  const int v = std::clamp(static_cast<int>(std::lround(v_px)), 1, frame.depth.rows - 2);
  const double depth = frame.depth_m(u, v);
  if (depth <= 0.0 || depth > options.max_depth_m) return 0.0f;
  for (int y = -1; y <= 1; ++y)
    for (int x = -1; x <= 1; ++x) {
      const double other = frame.depth_m(u + x, v + y);
      if (other > 0.0 && std::abs(other - depth) > options.depth_jump * depth) return 0.0f;
    }
  return static_cast<float>(depth);
}

}  // namespace

FeatureExtractor::FeatureExtractor(const FeatureOptions& options) : options_(options) {
  options_.validate();
  if (options_.low_fast_threshold > options_.fast_threshold)
    throw Error("FeatureOptions: low_fast_threshold is above fast_threshold");
}

std::vector<Feature> FeatureExtractor::extract(const rgbd::RgbdFrame& frame,
                                               const cv::Mat& exclude) const {
  const cv::Size size(frame.camera.width, frame.camera.height);
  if (frame.colour.size() != size || frame.colour.type() != CV_8UC3 || frame.depth.size() != size ||
      frame.depth.type() != CV_16UC1)
    throw Error("features: colour or depth image does not fit the camera of " + frame.source);
  if (!exclude.empty() && (exclude.size() != size || exclude.type() != CV_8UC1))
    throw Error("features: the excluded area does not fit the camera of " + frame.source);

  const double share = 1.0 / options_.scale;  // a level has 1/scale^2 the area, 1/scale the corners
  double weights = 0.0;
  for (int level = 0; level < options_.levels; ++level) weights += std::pow(share, level);

  const auto orb = cv::ORB::create(1 << 20, 2.0f, 1, kBorder - 1);
  cv::Mat image;
  cv::cvtColor(frame.colour, image, cv::COLOR_BGR2GRAY);
  std::vector<Feature> features;
  double weight = 0.0;  // of the levels so far; what one level lacks, the next may have
  for (int level = 0; level < options_.levels; ++level) {
    const double scale = std::pow(options_.scale, level);
    if (level > 0) {
      const cv::Size smaller(static_cast<int>(std::lround(size.width / scale)),
                             static_cast<int>(std::lround(size.height / scale)));
      cv::Mat next;
      cv::resize(image, next, smaller, 0.0, 0.0, cv::INTER_LINEAR);
      image = next;
    }
    if (image.cols <= 2 * kBorder || image.rows <= 2 * kBorder) break;
    const double to_full_u = static_cast<double>(size.width) / image.cols;
    const double to_full_v = static_cast<double>(size.height) / image.rows;
    const auto full_u = [&](float u) {
      return std::clamp(static_cast<float>((u + 0.5) * to_full_u - 0.5), 0.0f,
                        static_cast<float>(size.width - 1));
    };
    const auto full_v = [&](float v) {
      return std::clamp(static_cast<float>((v + 0.5) * to_full_v - 0.5), 0.0f,
                        static_cast<float>(size.height - 1));
    };
    std::vector<cv::KeyPoint> corners;
    const cv::Rect inner(kBorder - 3, kBorder - 3, image.cols - 2 * kBorder + 6,
                         image.rows - 2 * kBorder + 6);  // FAST needs 3 px around a corner itself
    cv::FAST(image(inner), corners, options_.low_fast_threshold, true);
    for (auto& corner : corners) {
      corner.pt.x += static_cast<float>(inner.x);
      corner.pt.y += static_cast<float>(inner.y);
      corner.octave = 0;
    }
    if (!exclude.empty())
      std::erase_if(corners, [&](const cv::KeyPoint& corner) {
        return exclude.at<std::uint8_t>(static_cast<int>(std::lround(full_v(corner.pt.y))),
                                        static_cast<int>(std::lround(full_u(corner.pt.x)))) != 0;
      });
    weight += std::pow(share, level);
    const int wanted = static_cast<int>(std::lround(options_.features * weight / weights)) -
                       static_cast<int>(features.size());
    corners = spread(std::move(corners), image.size(), wanted, options_);
    for (auto& corner : corners)
      corner.angle =
          orientation(image, static_cast<int>(corner.pt.x), static_cast<int>(corner.pt.y));
    if (corners.empty()) continue;
    cv::Mat descriptors;
    orb->compute(image, corners, descriptors);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      Feature feature;
      feature.u_px = full_u(corners[i].pt.x);
      feature.v_px = full_v(corners[i].pt.y);
      feature.depth_m = depth_at(frame, feature.u_px, feature.v_px, options_);
      feature.angle_deg = corners[i].angle;
      feature.level = level;
      std::memcpy(feature.descriptor.data(), descriptors.ptr(static_cast<int>(i)),
                  sizeof(Descriptor));
      features.push_back(feature);
    }
  }
  return features;
}

}  // namespace weft::slam
