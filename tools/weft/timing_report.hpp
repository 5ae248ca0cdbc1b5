#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "tools/weft/frame_name.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {

/// Quantiles by nearest rank, milliseconds.
struct Quantiles {
  double p50 = 0, p95 = 0, p99 = 0, max = 0;
};
Quantiles quantiles(std::vector<double> values_ms);

struct StageReport {
  std::string stage;
  std::size_t frames = 0;
  Quantiles wait;  // from the arrival of the last input to the start
  Quantiles work;  // from the start to the answer
  Quantiles cpu;   // CPU time of the process meanwhile
};

/// One stage's work on one frame; times in ms since the first input of all.
struct TimelineSpan {
  std::size_t frame = 0;  // in order of appearance
  std::size_t stage = 0;
  double received = 0, started = 0, finished = 0, published = 0;
  int status_code = 0;
};

/// Where the time went. Times of several hosts are only comparable as far as their clocks agree.
struct TimingReport {
  std::vector<StageReport> stages;  // in order of appearance: pipeline order in a replayed log
  std::vector<FrameName> frames;
  std::vector<TimelineSpan> spans;
  Quantiles end_to_end;          // of a frame: first input of any stage to the last answer
  double frames_per_second = 0;  // frames over the time from the first input to the last answer
};

/// Collects STAGE_TIMING messages; of repeats, the first counts.
class TimingCollector {
 public:
  void add(const weft::stage_timing_t& timing);
  TimingReport report() const;

 private:
  std::vector<weft::stage_timing_t> timings_;
  std::map<std::pair<std::string, FrameName>, bool> seen_;
};

/// The table people read.
std::string to_text(const TimingReport& report);
/// {frames, frames_per_second, end_to_end: {p50_ms ...}, stages: {NAME: {frames, p50_ms, p95_ms,
/// p99_ms, max_ms (work), wait_p50_ms ..., cpu_p50_ms ...}}} as JSON text.
std::string to_json(const TimingReport& report);

}  // namespace weft
