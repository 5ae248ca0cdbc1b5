#pragma once

#include <string>
#include <vector>

#include "stage/log.hpp"

namespace weft {

/// A log that takes its name when it is whole: written under another name beside it, and gone
/// without a trace when it was not finished.
class LogOut {
 public:
  /// inputs: logs that are read meanwhile. Throws Error when the output is one of them, under
  /// whatever name, or cannot be written.
  LogOut(const std::string& path, const std::vector<std::string>& inputs);
  ~LogOut();
  LogOut(const LogOut&) = delete;
  LogOut& operator=(const LogOut&) = delete;
  void write(std::int64_t timestamp_us, const std::string& channel,
             const std::vector<std::uint8_t>& data);
  /// Puts it on the disk, then in its place.
  void commit();
  std::int64_t events() const { return events_; }

 private:
  std::string path_;
  std::string part_;
  stage::LogWriter writer_;
  std::int64_t events_ = 0;
  bool committed_ = false;
};

}  // namespace weft
