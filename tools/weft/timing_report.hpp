#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tools/weft/frame_name.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {

/// Quantiles by nearest rank, milliseconds.
struct Quantiles {
  double p50 = 0, p95 = 0, p99 = 0, max = 0;
};
Quantiles quantiles(std::vector<double> values_ms);

struct StageReport {
  std::string stage;
  std::string host;
  std::size_t frames = 0;
  Quantiles wait;     // from the arrival of the last input to the start
  Quantiles work;     // from the start to the answer
  Quantiles publish;  // from the answer to its sending
  Quantiles cpu;      // CPU time of the process while at work
  std::size_t failed = 0, dropped = 0, missing_input = 0;  // by the answers' status
  std::int64_t gaps = 0;  // sequence numbers between its first and last frame without a timing
  std::size_t critical_frames = 0;  // on whose critical path it is
  double critical_ms = 0;           // mean of its part of those: way there, wait, work, publish
};

/// One stage's work on one frame; times in ms since the first input of all.
struct TimelineSpan {
  std::size_t frame = 0;  // in order of appearance
  std::size_t stage = 0;
  double received = 0, started = 0, finished = 0, published = 0;
  double cpu = 0;
  int queue_length = 0;
  int status_code = 0;
  bool critical = false;
};

/// The chain of stages that a frame's last answer waited for: backwards from the last answer, each
/// time to the stage whose answer came last among those that were read. Times in ms.
struct CriticalPath {
  std::size_t frame = 0;
  double total = 0;  // first input of the chain to the last answer
  struct Step {
    std::size_t span = 0;  // index in TimingReport::spans
    double transport = 0;  // from the sending by the step before to the arrival here
    double publish = 0;    // from the answer to its sending or to its arrival, which may be earlier
  };
  std::vector<Step> steps;  // first stage first
};

/// Where the time went. Times of several hosts are only comparable as far as their clocks agree.
struct TimingReport {
  std::vector<StageReport> stages;  // in order of appearance: pipeline order in a replayed log
  std::vector<FrameName> frames;
  std::vector<TimelineSpan> spans;
  std::vector<CriticalPath> critical_paths;  // one a frame
  Quantiles transport;                       // between the stages of the critical paths
  Quantiles end_to_end;          // of a frame: first input of any stage to the last answer
  double frames_per_second = 0;  // frames over the time from the first input to the last answer
  std::int64_t first_utime = 0;  // what the spans' times count from
};

/// Collects STAGE_TIMING messages; of repeats, the first counts.
class TimingCollector {
 public:
  void add(const weft::stage_timing_t& timing);
  /// Says which channels a stage reads and writes, for the critical path. Without it, a stage is
  /// taken to wait for whatever was answered last before its input arrived.
  void add(const weft::stage_status_t& status);
  TimingReport report() const;

 private:
  CriticalPath critical_path(const TimingReport& report,
                             const std::vector<std::size_t>& spans) const;
  struct Channels {
    std::set<std::string> inputs, outputs;
  };
  std::vector<weft::stage_timing_t> timings_;
  std::set<std::pair<std::string, FrameName>> seen_;
  std::map<std::string, Channels> channels_;
};

/// The table people read.
std::string to_text(const TimingReport& report);
/// {frames, frames_per_second, end_to_end: {p50_ms ...}, stages: {NAME: {frames, p50_ms, p95_ms,
/// p99_ms, max_ms (work), wait_p50_ms ..., publish_p50_ms ..., cpu_p50_ms ..., failed ...}}} as
/// JSON text.
std::string to_json(const TimingReport& report);
/// For chrome://tracing and ui.perfetto.dev: a process a host, a thread a stage, a slice a frame,
/// arrows along the critical paths.
std::string to_chrome_trace(const TimingReport& report);

}  // namespace weft
