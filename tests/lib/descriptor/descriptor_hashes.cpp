// Prints a hash of every descriptor's values on a synthetic scan and on crops of real ones, for
// same_bits_test.cpp to compare under other processors' features.
//   descriptor-hashes baseline|avx2|auto THREADS [PCD ...]
#include <cstdio>
#include <cstdlib>
#include <string>

#include "all_kinds.hpp"
#include "base/error.hpp"
#include "base/hash.hpp"
#include "bovw/describe.hpp"
#include "rgbd/cloud.hpp"
#include "rgbd/pcd_io.hpp"
#include "support/table_scene.hpp"

namespace weft {
namespace {

rgbd::RgbdFrame shirt() {
  test::TableScene scene;
  scene.camera = {240, 180, 200.0, 200.0, 119.5, 89.5};
  scene.cloth_m = [](double x, double y) { return test::shirt_m(x, y); };
  scene.colour = [](double x, double y, bool cloth) {
    return cloth ? test::planks(y, x) : test::white(x, y);
  };
  return scene.render();
}

/// The middle of a real scan.
rgbd::RgbdFrame crop(const std::string& path) {
  const auto cloud = rgbd::read_pcd(path);
  auto frame = rgbd::frame_from_cloud(cloud, rgbd::fit_camera(cloud, path).camera, 0.001, path);
  const cv::Rect middle(250, 180, 160, 120);
  frame.camera.width = middle.width;
  frame.camera.height = middle.height;
  frame.camera.cx -= middle.x;
  frame.camera.cy -= middle.y;
  frame.depth = frame.depth(middle).clone();
  if (!frame.colour.empty()) frame.colour = frame.colour(middle).clone();
  frame.mask = cv::Mat(middle.size(), CV_8UC1, cv::Scalar(255));
  return frame;
}

void print(const std::string& name, const rgbd::RgbdFrame& frame, const rgbd::Plane* table,
           SimdPath path, int threads) {
  for (const auto& kind : test::all_kinds()) {
    for (const bool rectified : {false, true}) {
      if (rectified && table == nullptr) continue;
      bovw::DescribeOptions options;
      options.descriptor = kind;
      options.descriptor.gdh.min_points = 5;  // the office is some metres away
      options.view.rectified = rectified;
      options.grid.step_px = 8;
      const auto descriptor = descriptor::make_descriptor(options.descriptor, path);
      if (descriptor->uses_colour() && frame.colour.empty()) continue;
      const auto described =
          bovw::describe_frame(frame, frame.mask, table, options, *descriptor, threads);
      const auto& field = described.field;
      if (field.points.empty()) throw Error(name + ": nothing was described");
      Hash64 hash;
      hash.add(field.state.data(), field.state.size());
      hash.add(field.values.data(), field.values.size());
      std::printf("%s %s %s %zu %s\n", name.c_str(), descriptor->name().c_str(),
                  rectified ? "rectified" : "sensor", field.points.size(),
                  to_hex(hash.value()).c_str());
    }
  }
}

}  // namespace
}  // namespace weft

int main(int argc, char** argv) {
  using namespace weft;
  try {
    if (argc < 3) throw Error("usage: descriptor-hashes baseline|avx2|auto THREADS [PCD ...]");
    const std::string name = argv[1];
    const auto path = name == "baseline" ? SimdPath::kBaseline
                      : name == "avx2"   ? SimdPath::kAvx2
                                         : SimdPath::kAuto;
    if (!simd_path_available(path)) throw Error("this processor has no " + name);
    const int threads = std::atoi(argv[2]);
    const auto frame = shirt();
    test::TableScene scene;
    const auto table = scene.table();
    print("shirt", frame, &table, path, threads);
    for (int i = 3; i < argc; ++i) print(argv[i], crop(argv[i]), nullptr, path, threads);
  } catch (const Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
