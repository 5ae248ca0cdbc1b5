#pragma once

#include <cstdint>
#include <exception>
#include <optional>
#include <vector>

namespace weft {

/// nullopt when the bytes are not exactly one message of this type. lcm-gen's decoders throw on a
/// string of length 0.
template <class Message>
std::optional<Message> decode_message(const std::vector<std::uint8_t>& data) {
  Message message{};
  const int size = static_cast<int>(data.size());
  try {
    if (message.decode(data.data(), 0, size) != size) return std::nullopt;
  } catch (const std::exception&) {
    return std::nullopt;
  }
  return message;
}

template <class Message>
std::vector<std::uint8_t> encode_message(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

}  // namespace weft
