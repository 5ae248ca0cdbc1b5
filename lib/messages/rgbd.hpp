#pragma once

#include "base/options.hpp"
#include "rgbd/frame.hpp"
#include "weft/rgbd_frame_t.hpp"

/// Frames to and from RGBD_FRAME messages.
namespace weft::messages {

struct FrameEncoding {
  enum class Colour { kJpeg, kPng };
  enum class Depth { kPalette, kPng16, kRvl };
  Colour colour = Colour::kJpeg;
  Depth depth = Depth::kPalette;
  int jpeg_quality = 95;
  int min_jpeg_quality = 75;

  void visit(OptionVisitor& v) {
    v.choice("colour", colour, {{"jpeg", Colour::kJpeg}, {"png", Colour::kPng}},
             "png is lossless and does not fit one message at 640x480");
    v.choice("depth", depth,
             {{"palette", Depth::kPalette}, {"png16", Depth::kPng16}, {"rvl", Depth::kRvl}},
             "all lossless; a Kinect-like 640x480 scan takes 14-35 KB, 39-94 KB, 140-190 KB");
    v.field("jpeg_quality", jpeg_quality, {1, 100}, "",
            "quality to begin with; 95 leaves the gradients that descriptors see untouched");
    v.field("min_jpeg_quality", min_jpeg_quality, {1, 100}, "",
            "lowest quality to make a frame fit one message; below it the frame travels in parts "
            "of the best quality");
  }
  void validate() const;
};

/// Fills in everything but header and status. The whole frame in one message: the runtime cuts what
/// is larger than stage::kMaxMessageBytes into numbered parts. Colour or mask may be empty, depth
/// not. Throws Error when the frame's images do not fit its camera.
void to_message(const rgbd::RgbdFrame& frame, const FrameEncoding& encoding, rgbd_frame_t& message);

/// What to decode: a stage that needs no depth saves the time.
struct Planes {
  bool colour = true;
  bool depth = true;
  bool mask = true;
};

/// Throws stage::InvalidInput for content no sender of ours makes: sizes that do not add up, parts
/// not put together, unknown encodings, images that do not decode to exactly the camera's size.
/// Colour and depth must be there when asked for; a mask is empty when the frame has none.
rgbd::RgbdFrame from_message(const rgbd_frame_t& message, Planes planes = {});

}  // namespace weft::messages
