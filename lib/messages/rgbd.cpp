#include "messages/rgbd.hpp"

#include <cmath>

#include "messages/view.hpp"
#include "rgbd/codec.hpp"
#include "rgbd/depth_code.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Message = rgbd_frame_t;
constexpr std::int64_t kMaxPixels = 4096 * 4096;

void check_image(const cv::Mat& image, int type, const rgbd::CameraModel& camera,
                 const char* what) {
  if (image.type() != type || image.cols != camera.width || image.rows != camera.height) {
    throw Error(std::string(what) + " image of type " + std::to_string(image.type()) + " and " +
                std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                " px does not belong to a camera of " + std::to_string(camera.width) + "x" +
                std::to_string(camera.height) + " px");
  }
}

Bytes encode_depth(const cv::Mat& depth, FrameEncoding::Depth encoding) {
  switch (encoding) {
    case FrameEncoding::Depth::kPng16:
      return rgbd::encode_png(depth, rgbd::PngKind::kDepth);
    case FrameEncoding::Depth::kRvl:
      return rgbd::encode_depth_rvl(depth);
    case FrameEncoding::Depth::kPalette:
      break;
  }
  return rgbd::encode_depth_palette(depth);
}

/// The best JPEG of at most max_bytes, else the one of the quality to begin with.
Bytes encode_jpeg(const cv::Mat& colour, const FrameEncoding& encoding, std::size_t max_bytes) {
  constexpr int kStep = 5;
  Bytes best = rgbd::encode_colour_jpeg(colour, encoding.jpeg_quality);
  // Twenty steps of quality save a factor of three or so: what is larger need not be tried.
  if (best.size() <= max_bytes || best.size() > 4 * max_bytes) return best;
  for (int quality = encoding.jpeg_quality - kStep; quality >= encoding.min_jpeg_quality;
       quality -= kStep) {
    Bytes smaller = rgbd::encode_colour_jpeg(colour, quality);
    if (smaller.size() <= max_bytes) return smaller;
  }
  return best;
}

}  // namespace

void FrameEncoding::validate() const {
  validate_fields(*this, "FrameEncoding");
  if (min_jpeg_quality > jpeg_quality)
    throw Error("FrameEncoding: min_jpeg_quality = " + std::to_string(min_jpeg_quality) +
                " must not exceed jpeg_quality = " + std::to_string(jpeg_quality));
}

void to_message(const rgbd::RgbdFrame& frame, const FrameEncoding& encoding, Message& message) {
  const rgbd::CameraModel& camera = frame.camera;
  camera.validate("frame " + frame.source);
  if (std::int64_t{camera.width} * camera.height > kMaxPixels)
    throw Error("frame " + frame.source + " has more than " + std::to_string(kMaxPixels) + " px");
  check_image(frame.depth, CV_16UC1, camera, "depth");
  message.source = frame.source;
  message.camera_model = to_message(camera);
  message.depth_unit_m = frame.depth_unit_m;
  message.part_index = 0;
  message.part_count = 1;

  const Bytes depth = encode_depth(frame.depth, encoding.depth);
  message.depth_encoding = encoding.depth == FrameEncoding::Depth::kPng16 ? Message::DEPTH_PNG16
                           : encoding.depth == FrameEncoding::Depth::kRvl ? Message::DEPTH_RVL
                                                                          : Message::DEPTH_PALETTE;
  Bytes mask;
  message.mask_encoding = Message::MASK_NONE;
  if (!frame.mask.empty()) {
    check_image(frame.mask, CV_8UC1, camera, "mask");
    mask = rgbd::encode_png(frame.mask, rgbd::PngKind::kMask);
    message.mask_encoding = Message::MASK_PNG;
  }
  Bytes colour;
  message.colour_encoding = Message::COLOUR_NONE;
  if (!frame.colour.empty()) {
    check_image(frame.colour, CV_8UC3, camera, "colour");
    if (encoding.colour == FrameEncoding::Colour::kPng) {
      colour = rgbd::encode_png(frame.colour, rgbd::PngKind::kColour);
      message.colour_encoding = Message::COLOUR_PNG;
    } else {
      message.data.clear();
      message.data_size = 0;
      const std::size_t others =
          static_cast<std::size_t>(message.getEncodedSize()) + depth.size() + mask.size();
      colour = encode_jpeg(frame.colour, encoding,
                           others < stage::kMaxMessageBytes ? stage::kMaxMessageBytes - others : 0);
      message.colour_encoding = Message::COLOUR_JPEG;
    }
  }
  message.colour_size = static_cast<std::int32_t>(colour.size());
  message.depth_size = static_cast<std::int32_t>(depth.size());
  message.mask_size = static_cast<std::int32_t>(mask.size());
  message.data = std::move(colour);
  message.data.insert(message.data.end(), depth.begin(), depth.end());
  message.data.insert(message.data.end(), mask.begin(), mask.end());
  message.data_size = static_cast<std::int32_t>(message.data.size());
}

rgbd::RgbdFrame from_message(const Message& message, Planes planes) {
  const std::string where = "RGBD_FRAME";
  const auto fail = [&](const std::string& what) {
    throw stage::InvalidInput(where + ": " + what);
  };
  rgbd::RgbdFrame frame;
  frame.source = message.source;
  frame.camera = from_message(message.camera_model, where);
  const int width = frame.camera.width, height = frame.camera.height;
  if (std::int64_t{width} * height > kMaxPixels)
    fail(std::to_string(width) + "x" + std::to_string(height) + " px are more than " +
         std::to_string(kMaxPixels));
  frame.depth_unit_m = message.depth_unit_m;
  if (!(frame.depth_unit_m > 0.0 && frame.depth_unit_m <= 1.0))
    fail("depth_unit_m = " + std::to_string(frame.depth_unit_m) + " is not within 0 to 1 m");
  if (message.part_count != 1 || message.part_index != 0)
    fail("part " + std::to_string(message.part_index) + " of " +
         std::to_string(message.part_count) + " is not a whole frame");
  const std::int64_t sizes[] = {message.colour_size, message.depth_size, message.mask_size};
  if (sizes[0] < 0 || sizes[1] < 0 || sizes[2] < 0 ||
      sizes[0] + sizes[1] + sizes[2] != static_cast<std::int64_t>(message.data.size())) {
    fail("colour_size " + std::to_string(sizes[0]) + ", depth_size " + std::to_string(sizes[1]) +
         " and mask_size " + std::to_string(sizes[2]) + " do not add up to the " +
         std::to_string(message.data.size()) + " bytes of data");
  }
  const std::pair<int, const char*> encodings[] = {{message.colour_encoding, "colour"},
                                                   {message.depth_encoding, "depth"},
                                                   {message.mask_encoding, "mask"}};
  for (int i = 0; i < 3; ++i) {
    if ((encodings[i].first == 0) != (sizes[i] == 0))
      fail(std::string(encodings[i].second) + " of encoding " + std::to_string(encodings[i].first) +
           " has " + std::to_string(sizes[i]) + " bytes");
  }
  if (planes.colour && message.colour_encoding == Message::COLOUR_NONE)
    fail("the frame of " + message.source + " has no colour");
  if (planes.depth && message.depth_encoding == Message::DEPTH_NONE)
    fail("the frame of " + message.source + " has no depth");
  const std::uint8_t* colour = message.data.data();
  const std::uint8_t* depth = colour + sizes[0];
  const std::uint8_t* mask = depth + sizes[1];
  const auto unknown = [&](int i) {
    fail("unknown " + std::string(encodings[i].second) + " encoding " +
         std::to_string(encodings[i].first));
  };
  try {
    const auto size = [&](int i) { return static_cast<std::size_t>(sizes[i]); };
    switch (planes.colour ? message.colour_encoding : Message::COLOUR_NONE) {
      case Message::COLOUR_NONE:
        break;
      case Message::COLOUR_JPEG:
        frame.colour = rgbd::decode_colour_jpeg(colour, size(0), width, height, where + ": colour");
        break;
      case Message::COLOUR_PNG:
        frame.colour = rgbd::decode_png(colour, size(0), rgbd::PngKind::kColour, width, height,
                                        where + ": colour");
        break;
      default:
        unknown(0);
    }
    switch (planes.depth ? message.depth_encoding : Message::DEPTH_NONE) {
      case Message::DEPTH_NONE:
        break;
      case Message::DEPTH_PNG16:
        frame.depth = rgbd::decode_png(depth, size(1), rgbd::PngKind::kDepth, width, height,
                                       where + ": depth");
        break;
      case Message::DEPTH_RVL:
        frame.depth = rgbd::decode_depth_rvl(depth, size(1), width, height, where);
        break;
      case Message::DEPTH_PALETTE:
        frame.depth = rgbd::decode_depth_palette(depth, size(1), width, height, where);
        break;
      default:
        unknown(1);
    }
    switch (planes.mask ? message.mask_encoding : Message::MASK_NONE) {
      case Message::MASK_NONE:
        break;
      case Message::MASK_PNG:
        frame.mask =
            rgbd::decode_png(mask, size(2), rgbd::PngKind::kMask, width, height, where + ": mask");
        break;
      default:
        unknown(2);
    }
  } catch (const stage::InvalidInput&) {
    throw;
  } catch (const Error& e) {
    throw stage::InvalidInput(e.what());
  }
  return frame;
}

}  // namespace weft::messages
