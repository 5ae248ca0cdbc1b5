#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace weft {

struct BusMessage {
  std::string channel;
  std::vector<std::uint8_t> data;
};

/// Where messages go and come from: LCM over UDP, or the queue of a process that holds all stages.
class Bus {
 public:
  virtual ~Bus() = default;
  virtual void publish(const std::string& channel, const std::vector<std::uint8_t>& data) = 0;
  /// The next message of anybody; nullopt when none came in time.
  virtual std::optional<BusMessage> receive(std::chrono::milliseconds timeout) = 0;
};

}  // namespace weft
