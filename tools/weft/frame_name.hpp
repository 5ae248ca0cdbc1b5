#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "stage/runner.hpp"

namespace weft {

using stage::FrameName;

/// CAMERA/SESSION/SEQ.
std::string to_string(const FrameName& frame);

/// What every message about a frame begins with, whatever its type.
struct FrameHeader {
  FrameName frame;
  std::int64_t utime = 0;
  std::int8_t status_code = 0;
  std::int16_t reason = 0;
  std::string text;
};

/// nullopt when the bytes do not begin with a fingerprint, a header_t and a status_t. STAGE_TIMING
/// and STAGE_STATUS have no status_t: read those as what they are.
std::optional<FrameHeader> read_frame_header(const std::vector<std::uint8_t>& message);

/// The frame of any message that begins with a header_t and names a camera, STAGE_TIMING included;
/// nullopt for STAGE_STATUS, which is about no frame.
std::optional<FrameName> read_frame_name(const std::vector<std::uint8_t>& message);

/// The same message under another seq and time. Throws Error when it has no header.
std::vector<std::uint8_t> rename_frame(const std::vector<std::uint8_t>& message, std::int64_t seq,
                                       std::int64_t utime);

}  // namespace weft
