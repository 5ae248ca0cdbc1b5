#pragma once

#include <cstdint>

/// What the test driver's camera sees: a function of the frame's number alone, so that a test knows
/// every pixel. Colour and depth carry the number in their first pixel.
namespace weft::test {

struct DriverScene {
  int width;
  int height;

  std::uint16_t depth(int frame, int u, int v) const {
    if (u == 0 && v == 0) return static_cast<std::uint16_t>(1000 + frame);
    if ((u / 16 + v / 16 + frame) % 7 == 0) return 0;
    return static_cast<std::uint16_t>(700 + (u * 3 + v * 5 + frame * 11) % 900);
  }
  /// channel: 0 red, 1 green, 2 blue
  std::uint8_t colour(int frame, int u, int v, int channel) const {
    if (u == 0 && v == 0) return channel == 0 ? static_cast<std::uint8_t>(frame) : 0;
    return static_cast<std::uint8_t>(u * (channel + 1) / 4 + v * (3 - channel) / 3 + frame * 5);
  }
};

constexpr const char* kDriverUri = "weft-test-camera";
constexpr float kDriverFieldOfViewRad = 1.0f;
constexpr int kDriverRateHz = 30;
constexpr int kDriverFrames = 10;  // then the camera falls silent

}  // namespace weft::test
