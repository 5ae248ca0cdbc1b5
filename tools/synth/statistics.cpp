#include "synth/statistics.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace weft::synth {
namespace {

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

std::array<double, 3> deciles(const std::vector<double>& values) {
  return {quantile(values, 0.1), quantile(values, 0.5), quantile(values, 0.9)};
}

cv::Mat polygon_mask(const dataset::Scene& scene) {
  cv::Mat mask(scene.frame.colour.size(), CV_8UC1, cv::Scalar(0));
  for (const auto& p : scene.polygons) {
    if (p.ignore) continue;
    std::vector<cv::Point> points;
    for (const auto& q : p.points) points.emplace_back(cvRound(q.x), cvRound(q.y));
    cv::fillConvexPoly(mask, points, cv::Scalar(255));
  }
  return mask;
}

double noise_of_flat_blocks(const cv::Mat& grey) {
  constexpr int kBlock = 16;
  std::vector<double> blocks;
  for (int y = 1; y + kBlock < grey.rows; y += kBlock) {
    for (int x = 1; x + kBlock < grey.cols; x += kBlock) {
      const double level = cv::mean(grey(cv::Rect(x, y, kBlock, kBlock)))[0];
      if (level < 15.0 || level > 240.0) continue;
      double sum = 0.0;
      for (int j = y; j < y + kBlock; ++j) {
        const auto *a = grey.ptr<std::uint8_t>(j - 1), *b = grey.ptr<std::uint8_t>(j);
        const auto* c = grey.ptr<std::uint8_t>(j + 1);
        for (int i = x; i < x + kBlock; ++i) {
          sum += std::abs(a[i - 1] - 2 * a[i] + a[i + 1] - 2 * b[i - 1] + 4 * b[i] - 2 * b[i + 1] +
                          c[i - 1] - 2 * c[i] + c[i + 1]);
        }
      }
      blocks.push_back(std::sqrt(3.14159265358979 / 2) / 6 * sum / (kBlock * kBlock));
    }
  }
  return quantile(std::move(blocks), 0.2);
}

void measure_gradient(const cv::Mat& grey, const cv::Mat& parts, ScanStatistics& out) {
  cv::Mat soft, sums;
  cv::GaussianBlur(grey, soft, {7, 7}, 1.24);  // sqrt((4 / 3)^2 - 1 / 4): the presmoothing of SIFT
  cv::Mat magnitude(grey.size(), CV_32FC1, cv::Scalar(0));
  for (int y = 1; y + 1 < grey.rows; ++y) {
    for (int x = 1; x + 1 < grey.cols; ++x) {
      const double dx = soft.at<std::uint8_t>(y, x + 1) - soft.at<std::uint8_t>(y, x - 1);
      const double dy = soft.at<std::uint8_t>(y + 1, x) - soft.at<std::uint8_t>(y - 1, x);
      magnitude.at<float>(y, x) = static_cast<float>(std::sqrt(dx * dx + dy * dy) / 510.0);
    }
  }
  cv::integral(magnitude, sums, CV_64F);
  std::vector<double> all, of_parts;
  for (int y = 8; y + 8 < grey.rows; y += 6) {
    for (int x = 8; x + 8 < grey.cols; x += 6) {
      const double norm = (sums.at<double>(y + 8, x + 8) - sums.at<double>(y - 8, x + 8) -
                           sums.at<double>(y + 8, x - 8) + sums.at<double>(y - 8, x - 8)) /
                          256.0;
      all.push_back(norm);
      if (parts.at<std::uint8_t>(y, x) != 0) of_parts.push_back(norm);
    }
  }
  out.gradient = deciles(all);
  out.gradient_of_parts = deciles(of_parts);
}

void measure_depth(const rgbd::RgbdFrame& frame, const cv::Mat& parts, ScanStatistics& out) {
  const cv::Mat& depth = frame.depth;
  const double unit_mm = 1000.0 * frame.depth_unit_m;
  std::vector<double> values;
  int missing_parts = 0, parts_count = 0;
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      const int z = depth.at<std::uint16_t>(y, x);
      if (z > 0) values.push_back(z * unit_mm);
      if (parts.at<std::uint8_t>(y, x) == 0) continue;
      ++parts_count;
      missing_parts += z == 0 ? 1 : 0;
    }
  }
  out.missing_share = 1.0 - static_cast<double>(values.size()) / static_cast<double>(depth.total());
  out.missing_of_parts = parts_count > 0 ? static_cast<double>(missing_parts) / parts_count : 0.0;
  if (values.empty()) return;
  const double median = quantile(values, 0.5);
  out.depth_median_m = median / 1000.0;

  // Neighbouring pixels that differ do so by whole steps: the smallest frequent difference.
  std::vector<double> steps;
  constexpr int kPatch = 24;
  struct Patch {
    double rms;
    std::array<double, 3> correlation;
  };
  std::vector<Patch> patches;
  for (int y0 = 0; y0 + kPatch <= depth.rows; y0 += kPatch) {
    for (int x0 = 0; x0 + kPatch <= depth.cols; x0 += kPatch) {
      Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
      Eigen::Vector3d b = Eigen::Vector3d::Zero();
      bool whole = true;
      for (int y = 0; y < kPatch && whole; ++y) {
        for (int x = 0; x < kPatch; ++x) {
          const int z = depth.at<std::uint16_t>(y0 + y, x0 + x);
          if (z == 0) {
            whole = false;
            break;
          }
          const Eigen::Vector3d row(x, y, 1.0);
          a += row * row.transpose();
          b += row * (z * unit_mm);
        }
      }
      if (!whole) continue;
      const Eigen::Vector3d plane = a.inverse() * b;
      std::array<std::array<double, kPatch>, kPatch> rest;
      double sum = 0.0;
      for (int y = 0; y < kPatch; ++y) {
        for (int x = 0; x < kPatch; ++x) {
          const double z = depth.at<std::uint16_t>(y0 + y, x0 + x) * unit_mm;
          const double r = z - plane.dot(Eigen::Vector3d(x, y, 1.0));
          rest[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)] = r;
          sum += r * r;
        }
      }
      Patch patch{std::sqrt(sum / (kPatch * kPatch)), {}};
      constexpr std::array<int, 3> kLags = {1, 4, 8};
      for (std::size_t k = 0; k < kLags.size() && sum > 0.0; ++k) {
        double product = 0.0;
        int count = 0;
        const auto lag = static_cast<std::size_t>(kLags[k]);
        for (std::size_t y = 0; y < kPatch; ++y) {
          for (std::size_t x = 0; x + lag < kPatch; ++x, count += 2) {
            product += rest[y][x] * rest[y][x + lag] + rest[x][y] * rest[x + lag][y];
          }
        }
        patch.correlation[k] = product / count / (sum / (kPatch * kPatch));
      }
      patches.push_back(patch);
    }
  }
  std::sort(patches.begin(), patches.end(),
            [](const Patch& p, const Patch& q) { return p.rms < q.rms; });
  if (!patches.empty()) {
    const std::size_t flat = std::max<std::size_t>(1, patches.size() / 5);
    out.depth_noise_mm = patches[flat - 1].rms;
    for (std::size_t k = 0; k < 3; ++k) {
      double sum = 0.0;
      for (std::size_t i = 0; i < flat; ++i) sum += patches[i].correlation[k];
      out.depth_correlation[k] = sum / static_cast<double>(flat);
    }
  }
  // Values near the median: gaps of the ladder of depths, where the sensor has one.
  std::sort(values.begin(), values.end());
  double last = 0.0;
  for (const double z : values) {
    if (std::abs(z - median) > 0.03 * median || z == last) continue;
    if (last > 0.0) steps.push_back(z - last);
    last = z;
  }
  out.depth_step_mm = quantile(std::move(steps), 0.5);
}

}  // namespace

void count_parts(const dataset::Scene& scene, std::map<std::string, PartCount>& parts) {
  for (const auto& p : scene.polygons) {
    PartCount& count = parts[p.part];
    if (p.ignore) {
      ++count.ignored;
      continue;
    }
    ++count.usable;
    cv::Point2f low = p.points.front(), high = low;
    for (const auto& q : p.points) {
      low = {std::min(low.x, q.x), std::min(low.y, q.y)};
      high = {std::max(high.x, q.x), std::max(high.y, q.y)};
    }
    if (cv::pointPolygonTest(p.points, 0.5f * (low + high), false) >= 0.0) ++count.centred;
  }
}

ScanStatistics scan_statistics(const dataset::Scene& scene) {
  ScanStatistics out;
  cv::Mat grey;
  cv::cvtColor(scene.frame.colour, grey, cv::COLOR_BGR2GRAY);
  const cv::Mat parts = polygon_mask(scene);
  out.colour_mean = cv::mean(grey)[0];
  int saturated = 0;
  for (int y = 0; y < grey.rows; ++y) {
    for (int x = 0; x < grey.cols; ++x) {
      const auto& p = scene.frame.colour.at<cv::Vec3b>(y, x);
      saturated += p[0] >= 254 || p[1] >= 254 || p[2] >= 254 ? 1 : 0;
    }
  }
  out.saturated_share = static_cast<double>(saturated) / static_cast<double>(grey.total());
  out.colour_noise = noise_of_flat_blocks(grey);
  measure_gradient(grey, parts, out);
  measure_depth(scene.frame, parts, out);
  return out;
}

}  // namespace weft::synth
