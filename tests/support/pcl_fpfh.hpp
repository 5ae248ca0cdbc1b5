#pragma once

#include <pcl/features/fpfh_omp.h>

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "rgbd/surface.hpp"

/// PCL's FPFH of points of an organised surface.
namespace weft::test {

class PclFpfh {
 public:
  /// Points without a normal are missing for PCL too: else it counts their pairs in bin 0.
  PclFpfh(const rgbd::Surface& surface, const cv::Mat& normals, double radius_m, int threads)
      : estimation_(static_cast<unsigned>(threads)) {
    const auto nan = cv::Vec3f::all(std::numeric_limits<float>::quiet_NaN());
    const cv::Mat& points = surface.points_m;
    const auto width = static_cast<unsigned>(points.cols);
    const auto height = static_cast<unsigned>(points.rows);
    auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>(width, height);
    auto cloud_normals = std::make_shared<pcl::PointCloud<pcl::Normal>>(width, height);
    for (int y = 0; y < points.rows; ++y) {
      for (int x = 0; x < points.cols; ++x) {
        auto p = points.at<cv::Vec3f>(y, x), n = normals.at<cv::Vec3f>(y, x);
        if (!std::isfinite(p[0] + p[1] + p[2]) || !std::isfinite(n[0] + n[1] + n[2])) p = n = nan;
        cloud->at(x, y) = {p[0], p[1], p[2]};
        cloud_normals->at(x, y) = {n[0], n[1], n[2]};
      }
    }
    cloud->is_dense = cloud_normals->is_dense = false;
    estimation_.setInputCloud(cloud);
    estimation_.setInputNormals(cloud_normals);
    estimation_.setRadiusSearch(radius_m);
  }
  /// FPFH of the points with these indices, 33 values each. Neighbours by PCL's search in organised
  /// clouds, its default for them and faster than its kd-tree.
  std::vector<float> of(const std::vector<int>& indices) {
    estimation_.setIndices(std::make_shared<pcl::Indices>(indices));
    pcl::PointCloud<pcl::FPFHSignature33> out;
    estimation_.compute(out);
    std::vector<float> values;
    for (const auto& each : out)
      values.insert(values.end(), std::begin(each.histogram), std::end(each.histogram));
    return values;
  }

 private:
  pcl::FPFHEstimationOMP<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> estimation_;
};

}  // namespace weft::test
