// Plane extraction on depth images, ours beside PCL's: from the depth image to planes with labels,
// back-projection included, on one thread.
#include <pcl/features/integral_image_normal.h>
#include <pcl/segmentation/organized_multi_plane_segmentation.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "bench/timing.hpp"
#include "dataset/plane_scans.hpp"
#include "dataset/sequence.hpp"
#include "plane/extractor.hpp"
#include "support/plane_scene.hpp"

namespace {

using namespace weft;  // NOLINT: a program

using Point = pcl::PointXYZ;

/// OrganizedMultiPlaneSegmentation with normals from integral images (Trevor et al., 2013), with
/// the settings of PCL's own example but for min_inliers, which is our least segment.
int peer_planes(const rgbd::RgbdFrame& frame, int min_inliers) {
  const auto& camera = frame.camera;
  pcl::PointCloud<Point>::Ptr cloud(new pcl::PointCloud<Point>(
      static_cast<std::uint32_t>(camera.width), static_cast<std::uint32_t>(camera.height)));
  cloud->is_dense = false;
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      const auto z = static_cast<float>(frame.depth_m(u, v));
      auto& p = cloud->at(u, v);
      p.x = p.y = p.z = std::numeric_limits<float>::quiet_NaN();
      if (z <= 0.0f) continue;
      p.x = static_cast<float>((u - camera.cx) / camera.fx) * z;
      p.y = static_cast<float>((v - camera.cy) / camera.fy) * z;
      p.z = z;
    }
  pcl::IntegralImageNormalEstimation<Point, pcl::Normal> estimation;
  estimation.setNormalEstimationMethod(estimation.COVARIANCE_MATRIX);
  estimation.setMaxDepthChangeFactor(0.02f);
  estimation.setNormalSmoothingSize(20.0f);
  estimation.setInputCloud(cloud);
  pcl::PointCloud<pcl::Normal>::Ptr normals(new pcl::PointCloud<pcl::Normal>);
  estimation.compute(*normals);
  pcl::OrganizedMultiPlaneSegmentation<Point, pcl::Normal, pcl::Label> segmentation;
  segmentation.setMinInliers(static_cast<unsigned>(min_inliers));
  segmentation.setAngularThreshold(0.017453 * 3.0);
  segmentation.setDistanceThreshold(0.02);
  segmentation.setInputNormals(normals);
  segmentation.setInputCloud(cloud);
  std::vector<pcl::PlanarRegion<Point>, Eigen::aligned_allocator<pcl::PlanarRegion<Point>>> regions;
  segmentation.segmentAndRefine(regions);
  return static_cast<int>(regions.size());
}

struct Input {
  std::string name;
  std::vector<rgbd::RgbdFrame> frames;
};

Input formula_room() {
  test::PlaneScene scene = test::room();
  scene.noise_per_m = 0.0012;
  scene.holes_share = 0.02;
  return {"room", {test::render(scene).frame}};
}

/// At most `limit` frames, spread over the folder.
Input read_folder(const std::string& folder, std::size_t limit) {
  Input input{folder.substr(folder.find_last_of('/') + 1), {}};
  const auto take = [&](std::size_t count,
                        const std::function<rgbd::RgbdFrame(std::size_t)>& read) {
    const std::size_t n = std::min(count, limit);
    for (std::size_t i = 0; i < n; ++i) input.frames.push_back(read(i * count / n));
  };
  if (!dataset::sequence_kind(folder).empty()) {
    const auto sequence = dataset::open_sequence(folder);
    take(sequence.frames.size(), [&](std::size_t i) { return sequence.read(i); });
  } else {
    const auto files = dataset::list_plane_scans(folder);
    take(files.size(), [&](std::size_t i) { return dataset::read_plane_scan(files[i]).frame; });
  }
  return input;
}

}  // namespace

int main(int argc, char** argv) {
  bench::keep_memory();
  CLI::App app{"Planes and cylinders of depth images, ours beside PCL's, on one thread"};
  std::vector<std::string> folders;
  std::size_t frames = 12;
  int runs = 5;
  bool with_peer = true;
  std::string json;
  app.add_option("--dataset", folders,
                 "recordings of a moving camera or folders of depth images; without one, a room "
                 "by formula with a Kinect's noise");
  app.add_option("--frames", frames, "of each folder")->check(CLI::Range(1, 10000));
  app.add_option("--runs", runs, "of each frame; the fastest counts")->check(CLI::Range(1, 1000));
  app.add_flag("!--no-peer", with_peer, "without PCL");
  app.add_option("--json", json, "file for the figures");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  try {
    std::vector<Input> inputs{formula_room()};
    for (const auto& folder : folders) inputs.push_back(read_folder(folder, frames));
    nlohmann::json report;
    double total_ms = 0.0;
    std::size_t total_frames = 0;
    std::printf("%-28s %6s %9s %9s %8s %9s %9s %7s\n", "", "frames", "ms", "frames/s", "planes",
                "PCL ms", "planes", "ratio");
    for (const auto& input : inputs) {
      const plane::Extractor extractor({});
      double ms = 0.0, peer_ms = 0.0;
      std::size_t planes = 0;
      int peer = 0;
      for (const auto& frame : input.frames) {
        plane::Extraction found;
        ms += bench::best_ms(runs, 1, [&] { found = extractor.extract(frame); });
        planes += found.planes.size();
        if (with_peer) {
          int regions = 0;
          peer_ms += bench::best_ms(1, 1, [&] { regions = peer_planes(frame, 1600); });
          peer += regions;
        }
      }
      const auto n = static_cast<double>(input.frames.size());
      std::printf("%-28s %6zu %9.2f %9.1f %8.1f %9.1f %9.1f %7.1f\n", input.name.c_str(),
                  input.frames.size(), ms / n, 1000.0 * n / ms, double(planes) / n, peer_ms / n,
                  peer / n, peer_ms / ms);
      report["inputs"][input.name] = {{"frames", input.frames.size()},
                                      {"ms", ms / n},
                                      {"frames_per_second", 1000.0 * n / ms},
                                      {"planes", double(planes) / n}};
      if (with_peer) {
        auto& entry = report["inputs"][input.name];
        entry["peer"] = "PCL OrganizedMultiPlaneSegmentation, integral image normals";
        entry["peer_ms"] = peer_ms / n;
        entry["ratio"] = peer_ms / ms;
      }
      total_ms += ms;
      total_frames += input.frames.size();
    }
    report["ms"] = total_ms / static_cast<double>(total_frames);
    report["frames_per_second"] = 1000.0 * static_cast<double>(total_frames) / total_ms;
    if (!json.empty()) {
      std::ofstream file(json);
      file << report.dump(2) << "\n";
      if (!file.flush()) throw Error(json + ": cannot be written");
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "weft-bench-planes: %s\n", e.what());
    return 1;
  }
  return 0;
}
