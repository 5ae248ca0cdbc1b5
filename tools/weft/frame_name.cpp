#include "tools/weft/frame_name.hpp"

#include <stdexcept>

#include "base/error.hpp"
#include "weft/header_t.hpp"
#include "weft/status_t.hpp"

namespace weft {
namespace {

constexpr int kFingerprintSize = 8;

/// Bytes of a nested type, or a negative number; lcm-gen's decoders throw on a string of length 0.
template <class Nested>
int decode_nested(Nested& nested, const std::vector<std::uint8_t>& bytes, int offset) {
  const int left = static_cast<int>(bytes.size()) - offset;
  if (left <= 0) return -1;
  try {
    return nested._decodeNoHash(bytes.data(), offset, left);
  } catch (const std::exception&) {
    return -1;
  }
}

}  // namespace

std::string to_string(const FrameName& frame) {
  return frame.camera + "/" + std::to_string(frame.session) + "/" + std::to_string(frame.seq);
}

std::optional<FrameHeader> read_frame_header(const std::vector<std::uint8_t>& message) {
  weft::header_t header;
  const int header_size = decode_nested(header, message, kFingerprintSize);
  if (header_size < 0) return std::nullopt;
  weft::status_t status;
  if (decode_nested(status, message, kFingerprintSize + header_size) < 0) return std::nullopt;
  return FrameHeader{{header.camera, header.session, header.seq},
                     header.utime,
                     status.code,
                     status.reason,
                     status.text};
}

std::optional<FrameName> read_frame_name(const std::vector<std::uint8_t>& message) {
  weft::header_t header;
  if (decode_nested(header, message, kFingerprintSize) < 0 || header.camera.empty() ||
      header.seq < 0)
    return std::nullopt;
  return FrameName{header.camera, header.session, header.seq};
}

std::vector<std::uint8_t> rename_frame(const std::vector<std::uint8_t>& message, std::int64_t seq,
                                       std::int64_t utime) {
  weft::header_t header;
  if (decode_nested(header, message, kFingerprintSize) < 0)
    throw Error("a message without a header cannot be given another frame's name");
  header.seq = seq;
  header.utime = utime;
  auto renamed = message;  // numbers have a fixed size, so the header keeps its length
  header._encodeNoHash(renamed.data(), kFingerprintSize,
                       static_cast<int>(renamed.size()) - kFingerprintSize);
  return renamed;
}

}  // namespace weft
