#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

/// Images as bytes and back. Encoders throw Error on images of the wrong type; decoders throw Error
/// starting with `where` unless the bytes hold an image of exactly the size and kind asked for,
/// which they check in the image's own header before anything is allocated by it.
namespace weft::rgbd {

/// colour: CV_8UC3 BGR. quality: 1 to 100. Chroma at half resolution.
std::vector<std::uint8_t> encode_colour_jpeg(const cv::Mat& colour, int quality);
/// The entropy-coded part has no checksum: flipped bits there go unseen.
cv::Mat decode_colour_jpeg(const std::uint8_t* data, std::size_t size, int width, int height,
                           const std::string& where);

/// Size a PNG or JPEG claims in its header, without decoding it. Throws Error when it is neither,
/// or when a side is not within 1 to 8192 px.
cv::Size image_size(const std::uint8_t* data, std::size_t size, const std::string& where);

/// CV_8UC3 BGR, CV_16UC1, CV_8UC1 of 0 and 255, CV_8UC1 of any values.
enum class PngKind { kColour, kDepth, kMask, kLabels };
/// Lossless. A mask is written with one bit a pixel.
std::vector<std::uint8_t> encode_png(const cv::Mat& image, PngKind kind);
cv::Mat decode_png(const std::uint8_t* data, std::size_t size, PngKind kind, int width, int height,
                   const std::string& where);

}  // namespace weft::rgbd
