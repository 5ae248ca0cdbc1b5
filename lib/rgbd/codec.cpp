#include "rgbd/codec.hpp"

#include <cstring>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"

namespace weft::rgbd {
namespace {

std::uint32_t big_endian(const std::uint8_t* at, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | at[i];
  return value;
}

void check_size(const cv::Size& size, int width, int height, const std::string& where) {
  if (size != cv::Size(width, height)) {
    throw Error(where + ": the image is " + std::to_string(size.width) + "x" +
                std::to_string(size.height) + " px, not " + std::to_string(width) + "x" +
                std::to_string(height));
  }
}

/// The frame header, which holds the size: walks over the segments before it. Its first byte is the
/// number of bits, its sixth the number of colours.
const std::uint8_t* jpeg_frame_header(const std::uint8_t* data, std::size_t size,
                                      const std::string& where) {
  const auto fail = [&](const char* what) { throw Error(where + ": not a usable JPEG: " + what); };
  if (size < 4 || data[0] != 0xff || data[1] != 0xd8) fail("it does not start as one");
  if (data[size - 2] != 0xff || data[size - 1] != 0xd9) fail("its end is missing");
  for (std::size_t at = 2;;) {
    if (at + 4 > size || data[at] != 0xff) fail("damaged segments");
    const std::uint8_t marker = data[at + 1];
    const std::size_t length = big_endian(data + at + 2, 2);
    if (length < 2 || at + 2 + length > size) fail("damaged segments");
    if (marker >= 0xc0 && marker <= 0xc2) {
      if (length < 8) fail("damaged segments");
      return data + at + 4;
    }
    if (marker == 0xda || marker == 0xd9 || (marker > 0xc2 && marker < 0xd0 && marker != 0xc4))
      fail("no baseline or progressive frame");
    at += 2 + length;
  }
}

/// The content of the first chunk: width and height of 4 bytes, bits, colour type.
const std::uint8_t* png_header(const std::uint8_t* data, std::size_t size,
                               const std::string& where) {
  if (size < 33 || std::memcmp(data, "\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16) != 0)
    throw Error(where + ": not a PNG");
  return data + 16;
}

void check_png(const std::uint8_t* data, std::size_t size, PngKind kind, int width, int height,
               const std::string& where) {
  const std::uint8_t* header = png_header(data, size, where);
  check_size(image_size(data, size, where), width, height, where);
  const int bits = header[8], colour_type = header[9];
  const bool good = kind == PngKind::kColour   ? bits == 8 && colour_type == 2
                    : kind == PngKind::kDepth  ? bits == 16 && colour_type == 0
                    : kind == PngKind::kLabels ? bits == 8 && colour_type == 0
                                               : (bits == 1 || bits == 8) && colour_type == 0;
  if (!good)
    throw Error(where + ": a PNG of colour type " + std::to_string(colour_type) + " with " +
                std::to_string(bits) + " bits is not what was expected here");
}

cv::Mat decode(const std::uint8_t* data, std::size_t size, int flags, int type, int width,
               int height, const std::string& where) {
  cv::Mat image;
  try {
    // OpenCV only reads from the matrix.
    const cv::Mat bytes(1, static_cast<int>(size), CV_8UC1, const_cast<std::uint8_t*>(data));
    image = cv::imdecode(bytes, flags);
  } catch (const cv::Exception& e) {
    throw Error(where + ": the image does not decode: " + e.what());
  }
  if (image.type() != type || image.cols != width || image.rows != height)
    throw Error(where + ": the image does not decode; damaged or truncated");
  return image;
}

std::vector<std::uint8_t> encode(const char* extension, const cv::Mat& image, int type,
                                 const std::vector<int>& parameters) {
  if (image.empty() || image.type() != type) {
    throw Error(std::string("cannot encode an image of type ") + std::to_string(image.type()) +
                " and size " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                " as " + extension);
  }
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(extension, image, bytes, parameters))
    throw Error(std::string("cannot encode as ") + extension);
  return bytes;
}

}  // namespace

cv::Size image_size(const std::uint8_t* data, std::size_t size, const std::string& where) {
  std::uint32_t width, height;
  if (size > 0 && data[0] == 0x89) {
    const std::uint8_t* header = png_header(data, size, where);
    width = big_endian(header, 4);
    height = big_endian(header + 4, 4);
  } else if (size > 0 && data[0] == 0xff) {
    const std::uint8_t* header = jpeg_frame_header(data, size, where);
    width = big_endian(header + 3, 2);
    height = big_endian(header + 1, 2);
  } else {
    throw Error(where + ": neither a PNG nor a JPEG image");
  }
  if (width < 1 || height < 1 || width > 8192 || height > 8192)
    throw Error(where + ": an image of " + std::to_string(width) + "x" + std::to_string(height) +
                " px is not within 1x1 to 8192x8192");
  return {static_cast<int>(width), static_cast<int>(height)};
}

std::vector<std::uint8_t> encode_colour_jpeg(const cv::Mat& colour, int quality) {
  return encode(".jpg", colour, CV_8UC3, {cv::IMWRITE_JPEG_QUALITY, quality});
}

cv::Mat decode_colour_jpeg(const std::uint8_t* data, std::size_t size, int width, int height,
                           const std::string& where) {
  const std::uint8_t* header = jpeg_frame_header(data, size, where);
  if (header[0] != 8 || header[5] != 3)
    throw Error(where + ": not a usable JPEG: not 3 colours of 8 bits");
  check_size(image_size(data, size, where), width, height, where);
  return decode(data, size, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, CV_8UC3, width,
                height, where);
}

std::vector<std::uint8_t> encode_png(const cv::Mat& image, PngKind kind) {
  const int type = kind == PngKind::kColour  ? CV_8UC3
                   : kind == PngKind::kDepth ? CV_16UC1
                                             : CV_8UC1;
  std::vector<int> parameters = {cv::IMWRITE_PNG_COMPRESSION, 6};
  // Fast: labels are sent with every frame, and have long runs.
  if (kind == PngKind::kLabels)
    parameters = {cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_PNG_STRATEGY,
                  cv::IMWRITE_PNG_STRATEGY_RLE};
  if (kind == PngKind::kMask) parameters.insert(parameters.end(), {cv::IMWRITE_PNG_BILEVEL, 1});
  return encode(".png", image, type, parameters);
}

cv::Mat decode_png(const std::uint8_t* data, std::size_t size, PngKind kind, int width, int height,
                   const std::string& where) {
  check_png(data, size, kind, width, height, where);
  if (kind == PngKind::kColour)
    return decode(data, size, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, CV_8UC3, width,
                  height, where);
  if (kind == PngKind::kDepth)
    return decode(data, size, cv::IMREAD_UNCHANGED, CV_16UC1, width, height, where);
  if (kind == PngKind::kLabels)
    return decode(data, size, cv::IMREAD_GRAYSCALE, CV_8UC1, width, height, where);
  cv::Mat mask = decode(data, size, cv::IMREAD_GRAYSCALE, CV_8UC1, width, height, where);
  for (int v = 0; v < mask.rows; ++v) {
    for (int u = 0; u < mask.cols; ++u) {
      if (mask.at<std::uint8_t>(v, u) != 0 && mask.at<std::uint8_t>(v, u) != 255) {
        throw Error(where + ": the mask holds the value " +
                    std::to_string(mask.at<std::uint8_t>(v, u)) + " at (" + std::to_string(u) +
                    ", " + std::to_string(v) + "); only 0 and 255 are meaningful");
      }
    }
  }
  return mask;
}

}  // namespace weft::rgbd
