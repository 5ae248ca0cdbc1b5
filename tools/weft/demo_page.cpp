#include "tools/weft/demo_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "tools/weft/page.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Blue, green, red; the page's script has the same list.
constexpr std::array<std::array<int, 3>, 11> kPalette = {{{75, 25, 230},
                                                          {28, 159, 255},
                                                          {75, 180, 60},
                                                          {34, 221, 170},
                                                          {239, 149, 72},
                                                          {224, 224, 70},
                                                          {237, 74, 177},
                                                          {230, 50, 240},
                                                          {25, 225, 255},
                                                          {78, 155, 201},
                                                          {171, 143, 255}}};

std::string file_name(const std::string& text) {
  std::string name;
  for (const char c : text) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    name += plain ? c : '-';
  }
  return name;
}

/// Outlines of the mask in sensor px.
json outline(const weft::foreground_t& foreground) {
  cv::Mat mask(foreground.height, foreground.width, CV_8UC1);
  std::uint8_t* pixel = mask.data;
  bool garment = false;
  for (const auto run : foreground.runs) {
    std::fill_n(pixel, run, static_cast<std::uint8_t>(garment ? 255 : 0));
    pixel += run;
    garment = !garment;
  }
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(mask, contours, cv::RETR_CCOMP, cv::CHAIN_APPROX_SIMPLE);
  json all = json::array();
  for (const auto& contour : contours) {
    if (cv::contourArea(contour) < 30) continue;
    std::vector<cv::Point> simple;
    cv::approxPolyDP(contour, simple, 0.8, true);
    json points = json::array();
    for (const auto& point : simple) points.push_back({point.x, point.y});
    all.push_back(std::move(points));
  }
  return all;
}

/// Grid values warped to the sensor image at half size, as the opacity of one colour; 255 means
/// full_scale.
cv::Mat overlay(const weft::probability_map_t& maps, const weft::part_map_t& map, int width,
                int height, double full_scale, const std::array<int, 3>& colour) {
  const cv::Mat grid(maps.rows, maps.columns, CV_8UC1,
                     const_cast<std::uint8_t*>(map.values.data()));
  const cv::Matx33d view_from_grid(maps.step_px, 0, maps.origin_x, 0, maps.step_px, maps.origin_y,
                                   0, 0, 1);
  const cv::Matx33d sensor_from_view(maps.view.sensor_from_view);
  const cv::Matx33d half(0.5, 0, -0.25, 0, 0.5, -0.25, 0, 0, 1);
  cv::Mat warped;
  cv::warpPerspective(grid, warped, cv::Mat(half * sensor_from_view * view_from_grid),
                      {width / 2, height / 2}, cv::INTER_LINEAR);
  warped.convertTo(warped, CV_8U, map.full_scale / full_scale);
  const cv::Mat planes[] = {cv::Mat(warped.size(), CV_8UC1, cv::Scalar(colour[0])),
                            cv::Mat(warped.size(), CV_8UC1, cv::Scalar(colour[1])),
                            cv::Mat(warped.size(), CV_8UC1, cv::Scalar(colour[2])), warped};
  cv::Mat image;
  cv::merge(planes, 4, image);
  return image;
}

}  // namespace

struct DemoPage::Data {
  fs::path folder;
  double threshold = 0;
  json frames = json::array();
  std::vector<std::string> parts;

  std::size_t part_index(const std::string& part) {
    const auto at = std::find(parts.begin(), parts.end(), part);
    if (at != parts.end()) return static_cast<std::size_t>(at - parts.begin());
    parts.push_back(part);
    return parts.size() - 1;
  }
};

DemoPage::DemoPage(fs::path folder, double threshold) : data_(std::make_unique<Data>()) {
  data_->folder = std::move(folder);
  data_->threshold = threshold;
  fs::remove_all(data_->folder / "frames");
  fs::create_directories(data_->folder / "frames");
}

DemoPage::~DemoPage() = default;

void DemoPage::add(const PlayedFrame& frame, const FrameContent& content,
                   const std::vector<dataset::PartPolygon>& truth) {
  auto& data = *data_;
  const std::string number = fmt::format("{:04}", data.frames.size());
  json entry{{"name", std::to_string(frame.source.name.seq)},
             {"source", ""},
             {"image", ""},
             {"width", 640},
             {"height", 480},
             {"latency_ms", 0},
             {"outline", json::array()},
             {"maps", json::array()},
             {"truth", json::array()},
             {"detections", json::array()},
             {"grasps", json::array()},
             {"problems", content.problems}};
  if (!frame.timings.empty()) {
    auto begin = frame.timings.front().received_utime, end = frame.timings.front().published_utime;
    for (const auto& timing : frame.timings) {
      begin = std::min(begin, timing.received_utime);
      end = std::max(end, timing.published_utime);
    }
    entry["latency_ms"] = static_cast<double>(end - begin) / 1000.0;
  }
  int width = 640, height = 480;
  if (content.rgbd) {
    const auto& rgbd = *content.rgbd;
    width = rgbd.camera_model.width;
    height = rgbd.camera_model.height;
    entry["source"] = rgbd.source;
    entry["width"] = width;
    entry["height"] = height;
    const bool jpeg = rgbd.colour_encoding == weft::rgbd_frame_t::COLOUR_JPEG;
    const bool png = rgbd.colour_encoding == weft::rgbd_frame_t::COLOUR_PNG;
    if (jpeg || png) {
      entry["image"] = "frames/" + number + (jpeg ? ".jpg" : ".png");
      write_text_file(data.folder / entry["image"],
                      std::string(rgbd.data.begin(), rgbd.data.begin() + rgbd.colour_size));
    }
  }
  if (content.foreground) entry["outline"] = outline(*content.foreground);
  if (content.maps) {
    double full_scale = 1e-6;  // one for the whole frame: a weak part looks weak
    for (const auto& map : content.maps->maps) full_scale = std::max(full_scale, map.full_scale);
    for (const auto& map : content.maps->maps) {
      const auto colour = kPalette[data.part_index(map.part) % kPalette.size()];
      const std::string name = "frames/" + number + "-" + file_name(map.part) + ".png";
      if (!cv::imwrite((data.folder / name).string(),
                       overlay(*content.maps, map, width, height, full_scale, colour)))
        throw Error((data.folder / name).string() + ": cannot write the probability map");
      entry["maps"].push_back({{"part", map.part}, {"image", name}});
    }
  }
  if (content.detections) {
    for (const auto& each : content.detections->detections) {
      data.part_index(each.part);
      json corners = json::array();
      for (const auto& corner : each.corners_sensor) corners.push_back({corner[0], corner[1]});
      entry["detections"].push_back(
          {{"part", each.part}, {"probability", each.probability}, {"corners", corners}});
    }
  }
  if (content.grasps && content.rgbd) {
    const auto& camera = content.rgbd->camera_model;
    for (const auto& each : content.grasps->grasps) {
      // The last 8 cm of the way to the cloth, as the camera sees them.
      double from[3];
      for (int i = 0; i < 3; ++i) from[i] = each.point_camera_m[i] - 0.08 * each.approach_camera[i];
      json tail{each.pixel[0], each.pixel[1]};
      if (from[2] > 0.05)
        tail = {camera.fx * from[0] / from[2] + camera.cx,
                camera.fy * from[1] / from[2] + camera.cy};
      entry["grasps"].push_back({{"part", each.part},
                                 {"detection", each.detection},
                                 {"score", each.score},
                                 {"pixel", {each.pixel[0], each.pixel[1]}},
                                 {"from", tail}});
    }
  }
  for (const auto& polygon : truth) {
    if (polygon.ignore) continue;
    data.part_index(polygon.part);
    json points = json::array();
    for (const auto& point : polygon.points) points.push_back({point.x, point.y});
    entry["truth"].push_back({{"part", polygon.part}, {"points", points}});
  }
  data.frames.push_back(std::move(entry));
}

void DemoPage::write(const std::string& title, const std::vector<Figure>& figures,
                     const TimingReport& timing) const {
  json list = json::array();
  for (const auto& figure : figures)
    list.push_back({{"name", figure.name}, {"value", figure.value}, {"kind", figure.kind}});
  const json page{
      {"title", title},        {"figures", list},         {"threshold", data_->threshold},
      {"parts", data_->parts}, {"frames", data_->frames}, {"timing", page_timing(timing)}};
  write_text_file(data_->folder / "index.html", make_page("demo.html", page));
}

}  // namespace weft
