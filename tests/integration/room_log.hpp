#pragma once

#include <string>

#include "dataset/trajectory_file.hpp"
#include "messages/rgbd.hpp"
#include "stage/log.hpp"
#include "support/textured_room.hpp"

namespace weft::test {

/// Writes a log of RGBD_FRAMEs, 0.1 s apart, of the camera that sways through the textured room,
/// `speed` times as fast as TexturedRoom::path. Returns where it was.
inline dataset::Trajectory write_room_log(const std::string& path, int frames, double speed = 1.0) {
  constexpr std::int64_t kStart = 1'700'000'000'000'000;
  stage::LogWriter log(path);
  dataset::Trajectory truth;
  const TexturedRoom room;
  for (int i = 0; i < frames; ++i) {
    const auto T_world_camera = TexturedRoom::path(0.1 * i * speed);
    rgbd_frame_t message{};
    messages::to_message(room.render(T_world_camera), {}, message);
    message.header.camera = "camera";
    message.header.coordinate_frame = "camera";
    message.header.session = 3;
    message.header.seq = i;
    message.header.utime = kStart + 100'000 * i;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    log.write(message.header.utime, "RGBD_FRAME", bytes);
    truth.push_back({message.header.utime, T_world_camera.rotation, T_world_camera.translation});
  }
  log.close();
  return truth;
}

}  // namespace weft::test
