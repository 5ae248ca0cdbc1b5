#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "base/settings.hpp"
#include "stage/channels.hpp"
#include "stage/runner.hpp"
#include "stage/stage.hpp"

/// A source produces frames instead of answering them: weft-capture. It has outputs and no inputs.
namespace weft::stage {

class Source {
 public:
  virtual ~Source() = default;
  /// No inputs; the outputs are published for each frame.
  virtual const Interface& interface() const = 0;
  /// Waits for the next frame and fills in the outputs. Their header holds camera, session and seq
  /// already, which the runtime owns; the source sets header.utime (time of measurement; preset to
  /// the time of the call) and header.coordinate_frame (preset to "camera"). Returns false at the
  /// end of the source, or soon (within 200 ms) after stop was requested. Throws Error when this
  /// one frame cannot be read, naming the file and the reason: the frame is published as FAILED
  /// (kSourceError) and the next call goes on with the frame after it.
  virtual bool next(Outputs& outputs, const std::stop_token& stop) = 0;
};

using SourceFactory = std::function<std::unique_ptr<Source>(const Settings& settings)>;

struct SourceRunnerOptions {
  std::string camera = "camera";
  std::int64_t session = 0;  // must differ between runs whose frames differ
  ChannelMap channels;
};

/// Names the frames of a source, answers for it when it throws, and cuts what does not fit one
/// message into numbered parts. Knows no transport: weft capture writes a log with it, SourceHost
/// publishes.
class SourceRunner {
 public:
  SourceRunner(Source& source, SourceRunnerOptions options);
  /// The next frame's messages in the order in which they must be sent; nothing at the end.
  /// now_us: preset of header.utime.
  std::optional<Answer> next(std::int64_t now_us, const std::stop_token& stop = {});
  const Counters& counters() const { return counters_; }

 private:
  Source& source_;
  SourceRunnerOptions options_;
  std::int64_t seq_ = 0;
  Counters counters_;
};

/// main() of a process that holds one source: --settings, --set, --name, --map, --url, --camera,
/// --session, --rate, --count, --trigger, --print-settings ... Runs until the source ends, or
/// SIGINT or SIGTERM; returns the exit status as run_process does: 1 also when a frame could not be
/// read.
int run_source(int argc, char** argv, const std::string& program, const std::string& summary,
               const SourceFactory& factory, const std::string& settings_reference);

}  // namespace weft::stage
