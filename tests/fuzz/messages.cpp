#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "fuzz/fuzz.hpp"
#include "messages/candidates.hpp"
#include "messages/detections.hpp"
#include "messages/foreground.hpp"
#include "messages/grasp.hpp"
#include "messages/maps.hpp"
#include "messages/prior.hpp"
#include "messages/rgbd.hpp"
#include "messages/words.hpp"

/// Messages whose content a stage reads: the generated decoder, then the checks of the content.
namespace weft::fuzz {
namespace {

template <class Message>
Bytes encoded(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

template <class Message>
Message with_header() {
  Message message{};
  message.header.camera = "camera";
  message.header.coordinate_frame = "camera";
  message.header.session = 1;
  message.header.seq = 2;
  return message;
}

/// check: what reads the decoded message.
template <class Message, class Check>
Target target(const std::vector<Message>& messages, const Check& check) {
  Target target{{}, [check](const Bytes& bytes) {
                  Message message{};
                  const int size = static_cast<int>(bytes.size());
                  if (message.decode(bytes.data(), 0, size) != size) throw Error("no such message");
                  check(message);
                }};
  for (const Message& message : messages) target.inputs.push_back(encoded(message));
  return target;
}

constexpr auto kFromMessage = [](const auto& message) { messages::from_message(message); };

bovw::WordGrid grid() {
  bovw::WordGrid grid;
  grid.descriptor = "sift";
  grid.vocabulary_hash = 7;
  grid.vocabulary_size = 4;
  grid.view.kind = rgbd::View::Kind::kRectified;
  grid.view.sensor = {64, 48, 50.0, 50.0, 32.0, 24.0};
  grid.view.width = 64;
  grid.view.height = 48;
  grid.view.scale_px_per_m = 600.0;
  grid.view.table.normal = {0.0, 0.0, -1.0};
  grid.view.table.distance_m = -0.8;
  grid.origin_x = grid.origin_y = 6;
  grid.step_px = 6;
  grid.columns = 3;
  grid.rows = 2;
  grid.cells = {-2, -1, 0, 3, 2, 1};
  return grid;
}

WEFT_FUZZ_TARGET(RgbdFrame) {
  rgbd::RgbdFrame frame;
  frame.source = "scene 7";
  frame.camera = {40, 30, 525.0, 525.5, 20, 15};
  frame.depth_unit_m = 0.001;
  frame.colour = cv::Mat(30, 40, CV_8UC3, cv::Scalar(10, 90, 200));
  frame.depth = cv::Mat(30, 40, CV_16UC1, cv::Scalar(900));
  frame.depth.at<std::uint16_t>(3, 4) = 0;
  frame.mask = cv::Mat(30, 40, CV_8UC1, cv::Scalar(255));
  std::vector<rgbd_frame_t> messages;
  using E = messages::FrameEncoding;
  for (const auto& [colour, depth] : {std::pair{E::Colour::kJpeg, E::Depth::kPalette},
                                      std::pair{E::Colour::kPng, E::Depth::kPng16},
                                      std::pair{E::Colour::kJpeg, E::Depth::kRvl}}) {
    messages.push_back(with_header<rgbd_frame_t>());
    messages::to_message(frame, {colour, depth}, messages.back());
  }
  return target(messages, kFromMessage);
}

WEFT_FUZZ_TARGET(Foreground) {
  foreground::Foreground foreground;
  foreground.mask = cv::Mat::zeros(30, 40, CV_8UC1);
  foreground.mask(cv::Rect(5, 6, 20, 15)) = 255;
  foreground.table = rgbd::Plane{};
  foreground.table->distance_m = -0.7;
  auto message = with_header<foreground_t>();
  messages::to_message(foreground, message);
  return target<foreground_t>({message}, kFromMessage);
}

WEFT_FUZZ_TARGET(Words) {
  auto message = with_header<words_t>();
  messages::to_message(grid(), message);
  return target<words_t>({message}, kFromMessage);
}

WEFT_FUZZ_TARGET(ProbabilityMap) {
  auto message = with_header<probability_map_t>();
  messages::to_message(
      {{"polo collar", 1.0, {1, 2, 3, 4, 5, 6}}, {"jeans hips", 0.5, {0, 0, 255, 0, 0, 0}}}, grid(),
      message);
  return target<probability_map_t>({message}, kFromMessage);
}

WEFT_FUZZ_TARGET(ImagePrior) {
  auto message = with_header<image_prior_t>();
  messages::to_message({{"polo collar", 0.5, 0.2, true}, {"jeans hips", 0.1, 0.2, false}},
                       detector::PriorMode::kHard, 7, message);
  return target<image_prior_t>({message}, kFromMessage);
}

WEFT_FUZZ_TARGET(PartCandidates) {
  auto message = with_header<part_candidates_t>();
  messages::to_message({{"polo collar", 3, 4, 0.5, 0.25}, {"jeans hips", 0, 0, 1.0, 1.0}}, 7,
                       message);
  return target<part_candidates_t>({message}, kFromMessage);
}

WEFT_FUZZ_TARGET(PartDetections) {
  detector::Detection detection;
  detection.part = "polo collar";
  detection.probability = 0.75;
  detection.box_view = {10.5, 20.25, 60, 48};
  detection.centre_sensor_px = {40.5, 44.25};
  detection.corners_sensor_px = {{{10.5, 20.25}, {70.5, 20.25}, {70.5, 68.25}, {10.5, 68.25}}};
  auto message = with_header<part_detections_t>();
  messages::to_message(grid().view, {detection, detection}, 7, message);
  return target<part_detections_t>({message}, kFromMessage);
}

WEFT_FUZZ_TARGET(Grasps) {
  detector::Grasp grasp;
  grasp.part = "jeans hips";
  grasp.detection = 3;
  grasp.score = 0.4;
  grasp.pixel = {320.0, 200.0};
  grasp.point_camera_m = {0.1, -0.2, 1.1};
  grasp.approach_camera = {0.0, 0.6, 0.8};
  auto message = with_header<grasps_t>();
  messages::to_message({grasp, grasp}, std::nullopt, message);
  return target<grasps_t>({message}, kFromMessage);
}

}  // namespace
}  // namespace weft::fuzz
