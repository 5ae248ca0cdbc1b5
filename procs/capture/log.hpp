#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "stage/source.hpp"

/// A source's frames as an LCM log instead of messages.
namespace weft::capture_process {

struct LogOptions {
  std::string camera = "camera";
  std::int64_t session = 0;
  double rate_hz = 10.0;  // decides the times of frames that have none of their own
  /// Time of the first frame, microseconds since the epoch. Fixed, so that the same files give the
  /// same bytes.
  std::int64_t start_utime = 1'700'000'000'000'000;
  long count = 0;  // frames to write; 0: until the source ends
};

struct LogResult {
  long frames = 0;
  long messages = 0;
  std::int64_t bytes = 0;
  std::vector<std::string> errors;  // of frames that could not be read
};

/// Writes every frame, FAILED ones included. progress(frames done) is called after each. Throws
/// Error when the log cannot be written.
LogResult write_log(stage::Source& source, const std::string& path, const LogOptions& options,
                    const std::function<void(const LogResult&)>& progress = nullptr,
                    const std::stop_token& stop = {});

}  // namespace weft::capture_process
