#pragma once

#include "synth/view_scene.hpp"

/// From ideal images to what a Kinect-like camera delivers.
namespace weft::synth {

/// CV_8UC3, BGR: vignetting, point spread, exposure, tone curve, Bayer mosaic, noise, JPEG.
cv::Mat sense_colour(const cv::Mat& radiance, const ColourSensor& sensor, std::uint64_t seed);

/// CV_16UC1, millimetres, 0 = missing. infrared_loss: by object, share of lost pixels.
cv::Mat sense_depth(const IdealImages& images, const DepthSensor& sensor,
                    const std::vector<Fabric>& fabrics, std::uint64_t seed);

}  // namespace weft::synth
