#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "mapping/map_log.hpp"
#include "mapping/map_picture.hpp"
#include "slam/map_file.hpp"

namespace weft::mapping {
namespace {

struct Command {
  std::string input, suffix, ply, pcd, obj, json, top, oblique, path;
  PictureOptions picture;
  bool live = false;
};

bool is_saved_map(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  char magic[8] = {};
  file.read(magic, sizeof magic);
  return std::string_view(magic, sizeof magic) == "WEFTBLOB";
}

MapContent read(const Command& command) {
  if (is_saved_map(command.input)) {
    auto saved = slam::read_map(command.input);
    return {std::move(saved.map), {}, std::move(saved.garments.garments)};
  }
  const auto log = read_map_log(command.input, command.suffix);
  if (log.map_ids.size() > 1)
    fmt::print(stderr, "{}: the map was begun {} times; this is the last one\n", command.input,
               log.map_ids.size());
  return {log.map, log.path(!command.live), log.garments};
}

void write_picture(const std::string& file, const cv::Mat& picture) {
  bool written = false;
  try {
    written = cv::imwrite(file, picture);
  } catch (const cv::Exception&) {
    // Another extension than OpenCV writes.
  }
  if (!written) throw Error(file + ": cannot be written; give it the extension .png or .jpg");
}

int export_map(const Command& command) {
  const MapContent content = read(command);
  if (!command.ply.empty()) write_text_file(command.ply, to_ply(content));
  if (!command.pcd.empty()) write_text_file(command.pcd, to_pcd(content));
  if (!command.obj.empty()) write_text_file(command.obj, to_obj(content));
  if (!command.json.empty()) write_text_file(command.json, to_json(content));
  if (!command.path.empty()) dataset::write_trajectory(command.path, content.path);
  if (!command.top.empty()) write_picture(command.top, top_picture(content, command.picture));
  if (!command.oblique.empty())
    write_picture(command.oblique, oblique_picture(content, command.picture));
  const auto in_map = std::count_if(content.garments.begin(), content.garments.end(),
                                    [](const auto& garment) { return garment.in_map; });
  fmt::print("map version {}: {} key frames, {} points, {} planes, {} garments; {} poses\n",
             content.map.version, content.map.key_frames.size(), content.map.points.size(),
             content.map.planes.size(), in_map, content.path.size());
  return 0;
}

int run(int argc, char** argv) {
  CLI::App app{"Writes what the processes have found in the formats of other programs.",
               "weft-export"};
  app.require_subcommand(1);
  Command command;
  auto* map = app.add_subcommand("map", "the map of a log, or a saved one");
  map->add_option(
         "input", command.input,
         "log with MAP_UPDATE and CAMERA_POSE, MAP_OBJECTS too, or a map that weft-map saved")
      ->required();
  map->add_option("--suffix", command.suffix, "of a variant's channels, such as @mine");
  std::vector<CLI::Option*> outputs = {
      map->add_option("--ply", command.ply, "points, planes and path as a point cloud"),
      map->add_option("--pcd", command.pcd, "the same for PCL"),
      map->add_option("--obj", command.obj, "planes as faces, path as a line, points"),
      map->add_option("--json", command.json, "everything, with numbers for programs"),
      map->add_option("--top", command.top, "picture from straight above (.png, .jpg)"),
      map->add_option("--oblique", command.oblique, "picture from obliquely above"),
      map->add_option("--path", command.path, "camera path in the TUM format")};
  map->add_flag("--live", command.live,
                "the path as it was said frame by frame, not as the map has corrected it since");
  map->add_option("--width", command.picture.width_px, "of pictures, px")
      ->check(CLI::Range(100, 8192))
      ->capture_default_str();
  map->add_option("--height", command.picture.height_px, "of pictures, px")
      ->check(CLI::Range(100, 8192))
      ->capture_default_str();
  map->callback([&] {
    if (std::none_of(outputs.begin(), outputs.end(),
                     [](const auto* o) { return o->count() > 0; })) {
      throw CLI::ValidationError(
          "nothing to write: give --ply, --pcd, --obj, --json, --top, "
          "--oblique or --path");
    }
  });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    return export_map(command);
  } catch (const std::exception& error) {
    fmt::print(stderr, "weft-export: {}\n", error.what());
    return 1;
  }
}

}  // namespace
}  // namespace weft::mapping

int main(int argc, char** argv) { return weft::mapping::run(argc, argv); }
