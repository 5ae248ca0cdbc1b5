#include "stage/telemetry.hpp"

#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <utility>

#include "stage/clock.hpp"
#include "weft/clock_pong_t.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft::stage {
namespace {

std::int64_t resident_bytes() {
  long pages = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(file, "%*d %ld", &pages) != 1) pages = 0;
    std::fclose(file);
  }
  return std::int64_t{pages} * sysconf(_SC_PAGESIZE);
}

template <class Message>
std::vector<std::uint8_t> encoded(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

}  // namespace

std::string build_text() { return WEFT_BUILD; }

Identity make_identity(const Interface& interface, const std::string& instance,
                       const ChannelMap& channels) {
  Identity identity;
  identity.stage = instance.empty() ? interface.name : instance;
  char host[256] = {};
  gethostname(host, sizeof host - 1);
  identity.host = host;
  identity.pid = getpid();
  identity.build = build_text();
  identity.started_us = now_us();
  identity.settings_hash = static_cast<std::int64_t>(interface.settings_hash);
  identity.model_hash = static_cast<std::int64_t>(interface.model_hash);
  for (const auto* ports : {&interface.inputs, &interface.outputs}) {
    for (const Port& port : *ports) {
      weft::type_fingerprint_t fingerprint{};
      fingerprint.direction = ports == &interface.inputs ? weft::type_fingerprint_t::INPUT
                                                         : weft::type_fingerprint_t::OUTPUT;
      if (port.frames_back > 0)
        fingerprint.direction =
            static_cast<std::int8_t>(weft::type_fingerprint_t::OUTPUT + port.frames_back);
      fingerprint.channel = wire_channel(channels, port.channel);
      fingerprint.type = port.type.name;
      fingerprint.fingerprint = port.type.fingerprint;
      identity.fingerprints.push_back(fingerprint);
    }
  }
  return identity;
}

std::vector<std::uint8_t> timing_message(const Identity& identity, const Answer& answer,
                                         std::int64_t published_us) {
  weft::stage_timing_t timing{};
  timing.header = answer.header;
  timing.stage = identity.stage;
  timing.host = identity.host;
  timing.status_code = answer.status_code;
  timing.received_utime = answer.received_us;
  timing.started_utime = answer.started_us;
  timing.finished_utime = answer.finished_us;
  timing.published_utime = published_us;
  timing.cpu_us = answer.cpu_us;
  timing.queue_length = answer.queue_length;
  for (const Publication& message : answer.messages)
    timing.output_bytes += static_cast<std::int32_t>(message.bytes.size());
  return encoded(timing);
}

std::vector<std::uint8_t> status_message(const Identity& identity, const Counters& counters,
                                         std::int8_t state, std::int64_t seq) {
  weft::stage_status_t status{};
  status.header.utime = now_us();
  status.header.session = identity.started_us;
  status.header.seq = seq;
  status.stage = identity.stage;
  status.host = identity.host;
  status.pid = identity.pid;
  status.state = state;
  status.started_utime = identity.started_us;
  status.build = identity.build;
  status.settings_hash = identity.settings_hash;
  status.model_hash = identity.model_hash;
  status.frames_in = counters.frames_in;
  status.frames_out = counters.frames_out;
  status.frames_dropped = counters.frames_dropped;
  status.frames_failed = counters.frames_failed;
  status.frames_missing_input = counters.frames_missing_input;
  status.gaps = counters.gaps;
  status.repeats = counters.repeats;
  status.decode_failures = counters.decode_failures;
  status.invalid_inputs = counters.invalid_inputs;
  status.resident_bytes = resident_bytes();
  status.last_error = counters.last_error;
  status.fingerprint_count = static_cast<std::int32_t>(identity.fingerprints.size());
  status.fingerprints = identity.fingerprints;
  return encoded(status);
}

std::vector<std::uint8_t> ClockAnswers::answer(const Identity& identity, const void* data,
                                               std::size_t size, std::int64_t received_us) {
  weft::clock_pong_t pong{};
  const int bytes = static_cast<int>(std::min<std::size_t>(size, kMaxMessageBytes));
  if (pong.header.decode(data, 0, bytes) != static_cast<int>(size) ||
      pong.header.camera.size() > kMaxNameLength ||
      pong.header.coordinate_frame.size() > kMaxNameLength) {
    ++decode_failures_;
    return {};
  }
  if (std::exchange(second_, received_us / 1'000'000) != received_us / 1'000'000) in_second_ = 0;
  if (++in_second_ > kMostASecond) return {};
  pong.stage = identity.stage;
  pong.host = identity.host;
  pong.pid = identity.pid;
  pong.received_utime = received_us;
  pong.set_by_us = host_clock_us() - now_us();
  pong.answered_utime = now_us();
  return encoded(pong);
}

namespace {
sigset_t stop_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  return signals;
}
}  // namespace

void block_stop_signals() {
  const sigset_t signals = stop_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

void run_until_stopped(const std::stop_token& stop, const std::function<void()>& tick) {
  constexpr std::int64_t kPeriod_us = 1'000'000;
  const sigset_t signals = stop_signals();
  std::int64_t next = now_us();
  while (!stop.stop_requested()) {
    if (now_us() >= next) {
      tick();
      next = std::max(next + kPeriod_us, now_us());
    }
    const timespec wait{0, 50'000'000};
    if (sigtimedwait(&signals, nullptr, &wait) > 0) break;
  }
  pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
}

}  // namespace weft::stage
