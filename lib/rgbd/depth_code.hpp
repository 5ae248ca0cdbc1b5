#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

/// Lossless codes for depth images (CV_16UC1). Integers only: the same bytes everywhere.
namespace weft::rgbd {

/// Palette code. A depth sensor knows only as many distances as it has disparities, so depths
/// become indices into the sorted list of those that occur; an index is predicted from its
/// neighbours (median edge detector of JPEG-LS, ITU-T T.87 A.3), and the error coded by a range
/// asymmetric numeral system (Duda 2013) with frequencies of its own for each pattern of the
/// neighbours' differences. Two fifths of the size of a 16-bit PNG on Kinect-like scans. Images up
/// to 8192x8192 and 2^26 px.
std::vector<std::uint8_t> encode_depth_palette(const cv::Mat& depth);
/// Throws Error starting with `where` unless the bytes are exactly a width x height image.
cv::Mat decode_depth_palette(const std::uint8_t* data, std::size_t size, int width, int height,
                             const std::string& where);

/// RVL: run-length and variable-length coded differences (Wilson, Fast Lossless Depth Image
/// Compression, 2017). Large, but the fastest.
std::vector<std::uint8_t> encode_depth_rvl(const cv::Mat& depth);
/// Throws Error starting with `where` unless the bytes are exactly a width x height image.
cv::Mat decode_depth_rvl(const std::uint8_t* data, std::size_t size, int width, int height,
                         const std::string& where);

}  // namespace weft::rgbd
