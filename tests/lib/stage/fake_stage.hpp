#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "stage/runner.hpp"
#include "stage/stage.hpp"
#include "weft/foreground_t.hpp"
#include "weft/grasps_t.hpp"
#include "weft/part_map_t.hpp"
#include "weft/probability_map_t.hpp"
#include "weft/rgbd_frame_t.hpp"
#include "weft/words_t.hpp"

/// Stages whose process() the test writes, and messages to feed them.
namespace weft::stage::fake {

using Bytes = std::vector<std::uint8_t>;
using weft::status_t;

class FakeStage : public Stage {
 public:
  FakeStage(Interface interface, std::function<void(const Inputs&, Outputs&)> body)
      : interface_(std::move(interface)), body_(std::move(body)) {}
  const Interface& interface() const override { return interface_; }
  void process(const Inputs& inputs, Outputs& outputs) override { body_(inputs, outputs); }

 private:
  Interface interface_;
  std::function<void(const Inputs&, Outputs&)> body_;
};

template <class Message>
Bytes encode(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

/// A default message when the bytes are no such message.
template <class Message>
Message decode(const Bytes& bytes) {
  Message message{};
  const int size = static_cast<int>(bytes.size());
  if (message.decode(bytes.data(), 0, size) != size) return Message{};
  return message;
}

inline header_t header(std::int64_t seq, std::int64_t session = 1,
                       const std::string& camera = "left") {
  header_t h{};
  h.utime = 1'000'000 + seq % 1'000'000;
  h.camera = camera;
  h.session = session;
  h.seq = seq;
  h.coordinate_frame = "camera";
  return h;
}

template <class Message>
Message message(const header_t& h, std::int8_t code = status_t::OK) {
  Message m{};
  m.header = h;
  m.status.code = code;
  return m;
}

inline rgbd_frame_t frame(const header_t& h, std::size_t data_bytes = 10) {
  auto m = message<rgbd_frame_t>(h);
  m.part_count = 1;
  for (std::size_t i = 0; i < data_bytes; ++i)
    m.data.push_back(static_cast<std::uint8_t>(i * 31 + static_cast<std::size_t>(h.seq)));
  m.data_size = static_cast<std::int32_t>(data_bytes);
  return m;
}

/// RGBD_FRAME to WORDS: counts the bytes of the frame; what most tests use.
inline FakeStage counter() {
  Interface interface;
  interface.name = "counter";
  interface.inputs = {port<rgbd_frame_t>("RGBD_FRAME")};
  interface.outputs = {port<words_t>("WORDS")};
  return {interface, [](const Inputs& in, Outputs& out) {
            auto& words = out.at<words_t>("WORDS");
            words.vocabulary_size = in.get<rgbd_frame_t>("RGBD_FRAME").data_size;
          }};
}

/// RGBD_FRAME and FOREGROUND to WORDS and GRASPS.
inline FakeStage joiner() {
  Interface interface;
  interface.name = "joiner";
  interface.inputs = {port<rgbd_frame_t>("RGBD_FRAME"), port<foreground_t>("FOREGROUND")};
  interface.outputs = {port<words_t>("WORDS"), port<grasps_t>("GRASPS")};
  return {interface, [](const Inputs& in, Outputs& out) {
            out.at<words_t>("WORDS").vocabulary_size =
                in.get<rgbd_frame_t>("RGBD_FRAME").data_size +
                in.get<foreground_t>("FOREGROUND").garment_px;
          }};
}

/// Like counter(), but a function of all frames so far; writes down the order.
inline FakeStage remembering(std::vector<std::int64_t>& order) {
  FakeStage plain = counter();
  Interface interface = plain.interface();
  interface.stateful = true;
  return {interface, [&order](const Inputs& in, Outputs& out) {
            order.push_back(in.header().seq);
            out.at<words_t>("WORDS").vocabulary_size = static_cast<std::int32_t>(order.size());
          }};
}

}  // namespace weft::stage::fake
