#pragma once

#include <filesystem>

#include "base/random.hpp"
#include "stage/log.hpp"
#include "weft/rgbd_frame_t.hpp"

namespace weft::test_stage {

/// All of a frame but its header: random bytes; bytes: of the payload.
inline void fill_test_frame(std::int64_t seq, std::size_t bytes, weft::rgbd_frame_t& frame) {
  frame.source = "scene " + std::to_string(seq);
  frame.camera_model = {320, 240, 262.5, 262.5, 159.5, 119.5};
  frame.depth_unit_m = 0.001;
  frame.part_count = 1;
  Random random(static_cast<std::uint64_t>(seq));
  for (std::size_t i = 0; i < bytes; ++i)
    frame.data.push_back(static_cast<std::uint8_t>(random.bits()));
  frame.data_size = static_cast<std::int32_t>(bytes);
  frame.colour_size = frame.data_size;
}

inline stage::LogEvent test_event(std::int64_t seq, std::size_t bytes) {
  weft::rgbd_frame_t frame{};
  frame.header = {1'700'000'000'000'000 + seq * 100'000, "camera", 7, seq, "camera"};
  fill_test_frame(seq, bytes, frame);
  stage::LogEvent event{0, frame.header.utime, "RGBD_FRAME", {}};
  event.data.resize(static_cast<std::size_t>(frame.getEncodedSize()));
  frame.encode(event.data.data(), 0, static_cast<int>(event.data.size()));
  return event;
}

/// A log as a logger leaves it: `frames` source frames, among them messages of other channels.
inline void write_test_log(const std::filesystem::path& file, int frames,
                           std::size_t bytes = 120'000) {
  stage::LogWriter log(file.string());
  for (int seq = 0; seq < frames; ++seq) {
    log.write(1, "RGBD_FRAME", test_event(seq, bytes).data);
    log.write(1, "LCM_SELF_TEST", std::vector<std::uint8_t>{1, 2, 3});
    log.write(1, "FOREGROUND", std::vector<std::uint8_t>{4, 5, 6});
  }
  log.close();
}

}  // namespace weft::test_stage
