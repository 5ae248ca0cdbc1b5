#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "stage/runner.hpp"
#include "weft/type_fingerprint_t.hpp"

/// STAGE_TIMING and STAGE_STATUS, the only places for times, hosts and counters.
namespace weft::stage {

inline constexpr const char* kTimingChannel = "STAGE_TIMING";
inline constexpr const char* kStatusChannel = "STAGE_STATUS";

/// Who reports.
struct Identity {
  std::string stage;  // the instance's name in the process set
  std::string host;
  std::int32_t pid = 0;
  std::string build;
  std::int64_t started_us = 0;
  std::int64_t settings_hash = 0;
  std::int64_t model_hash = 0;
  std::vector<weft::type_fingerprint_t> fingerprints;
};

/// instance: empty for the interface's own name.
Identity make_identity(const Interface& interface, const std::string& instance,
                       const ChannelMap& channels);

/// Version and build type of this library, e.g. "0.1.0 RelWithDebInfo".
std::string build_text();

/// Encoded stage_timing_t.
std::vector<std::uint8_t> timing_message(const Identity& identity, const Answer& answer,
                                         std::int64_t published_us);

/// Encoded stage_status_t. state: of stage_status_t; seq counts the reports of this process.
std::vector<std::uint8_t> status_message(const Identity& identity, const Counters& counters,
                                         std::int8_t state, std::int64_t seq);

/// Clocks are compared by a message exchange: a header_t on CLOCK_PING is answered by every process
/// with a clock_pong_t on CLOCK_PONG.
inline constexpr const char* kPingChannel = "CLOCK_PING";
inline constexpr const char* kPongChannel = "CLOCK_PONG";

/// The answers of one process. No more than kMostASecond: a flood of questions makes no flood of
/// answers.
class ClockAnswers {
 public:
  static constexpr int kMostASecond = 50;
  /// The encoded answer, or nothing: too many questions, or bytes that are none (counted).
  std::vector<std::uint8_t> answer(const Identity& identity, const void* data, std::size_t size,
                                   std::int64_t received_us);
  std::int64_t decode_failures() const { return decode_failures_; }

 private:
  std::int64_t second_ = 0;
  int in_second_ = 0;
  std::int64_t decode_failures_ = 0;
};

/// Blocks SIGINT and SIGTERM in this thread and those it starts, so that run_until_stopped sees
/// them. Call it before any thread is started.
void block_stop_signals();

/// Calls tick at once and then once a second until SIGINT or SIGTERM comes (when blocked) or stop
/// is requested. Afterwards a second signal ends the process at once.
void run_until_stopped(const std::stop_token& stop, const std::function<void()>& tick);

}  // namespace weft::stage
