#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"
#include "dataset/readers.hpp"
#include "rgbd/codec.hpp"

namespace weft::dataset {
namespace {

cv::Mat read_image(const std::string& path, int flags, int type, const char* expected) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  std::ifstream in(path, std::ios::binary);
  if (error || !in) throw Error(path + ": cannot be opened as a file");
  std::vector<std::uint8_t> bytes(size);
  if (!in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size)))
    throw Error(path + ": cannot be read");
  rgbd::image_size(bytes.data(), bytes.size(), path);
  cv::Mat image;
  try {
    image = cv::imdecode(bytes, flags);
  } catch (const cv::Exception& e) {
    throw Error(path + ": does not decode: " + e.what());
  }
  if (image.empty()) throw Error(path + ": does not decode; damaged or truncated");
  if (image.type() != type)
    throw Error(path + ": " + std::to_string(image.channels()) + " channels of " +
                std::to_string(8 * image.elemSize1()) + " bits, expected " + expected);
  return image;
}

}  // namespace

cv::Mat read_colour_image(const std::string& path) {
  return read_image(path, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, CV_8UC3, "colour");
}

cv::Mat read_depth_image(const std::string& path) {
  cv::Mat depth =
      read_image(path, cv::IMREAD_UNCHANGED, CV_16UC1, "a depth image: 1 channel of 16 bits");
  for (int v = 0; v < depth.rows; ++v)
    for (int u = 0; u < depth.cols; ++u)
      if (auto& d = depth.at<std::uint16_t>(v, u); d == 65535) d = 0;
  return depth;
}

}  // namespace weft::dataset
