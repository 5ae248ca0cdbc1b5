#pragma once

#include <memory>
#include <string>

#include "stage/lcm_url.hpp"
#include "stage/runner.hpp"
#include "stage/source.hpp"

namespace weft::stage {

struct HostOptions {
  std::string name;  // of the instance; empty: the interface's own
  LcmUrl url;
  RunnerOptions runner;
};

/// One stage in a process of its own, over LCM. A receive thread always drains LCM, a worker thread
/// processes and publishes; STAGE_STATUS goes out once a second from the thread that called run().
class Host {
 public:
  /// Connects and subscribes: from here on no message is missed. Throws Error (see connect()).
  Host(Stage& stage, const HostOptions& options);
  ~Host();
  /// Until request_stop(), or SIGINT or SIGTERM when block_stop_signals() was called. Finishes the
  /// frame being processed, publishes STOPPING, returns.
  void run();
  void request_stop();  // from any thread

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

struct SourceHostOptions {
  std::string name;
  LcmUrl url;
  SourceRunnerOptions source;
  double rate_hz = 0;      // frames a second; 0: as fast as the source gives them
  std::int64_t count = 0;  // frames to publish; 0: until the source ends
  /// Publish one frame for each message on CAPTURE_TRIGGER: a header_t whose camera is this one or
  /// empty. The same (camera, session, seq) triggers once.
  bool on_trigger = false;
  /// Pause after each numbered part, so that receivers with stock buffers keep up.
  std::int64_t part_pause_us = 5000;
};

inline constexpr const char* kTriggerChannel = "CAPTURE_TRIGGER";

/// One source in a process of its own, over LCM.
class SourceHost {
 public:
  SourceHost(Source& source, SourceHostOptions options);
  ~SourceHost();
  /// Until the source ends, the count is reached, request_stop(), SIGINT or SIGTERM.
  void run();
  void request_stop();
  Counters counters() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace weft::stage
