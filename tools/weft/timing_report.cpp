#include "tools/weft/timing_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace weft {

Quantiles quantiles(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    const auto rank =
        static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
    return values[std::max<std::size_t>(rank, 1) - 1];
  };
  return {at(0.50), at(0.95), at(0.99), values.back()};
}

void TimingCollector::add(const weft::stage_timing_t& timing) {
  const FrameName frame{timing.header.camera, timing.header.session, timing.header.seq};
  if (seen_.emplace(std::make_pair(timing.stage, frame), true).second) timings_.push_back(timing);
}

TimingReport TimingCollector::report() const {
  TimingReport report;
  if (timings_.empty()) return report;
  std::map<std::string, std::size_t> stage_index;
  std::map<FrameName, std::size_t> frame_index;
  std::int64_t first = std::numeric_limits<std::int64_t>::max();
  std::int64_t last = std::numeric_limits<std::int64_t>::min();
  for (const auto& timing : timings_) {
    first = std::min(first, timing.received_utime);
    last = std::max(last, timing.published_utime);
  }
  struct Values {
    std::vector<double> wait, work, cpu;
  };
  std::vector<Values> values;
  std::vector<std::pair<double, double>> frame_times;
  for (const auto& timing : timings_) {
    const FrameName name{timing.header.camera, timing.header.session, timing.header.seq};
    const auto [stage, new_stage] = stage_index.emplace(timing.stage, report.stages.size());
    if (new_stage) {
      report.stages.push_back({timing.stage, 0, {}, {}, {}});
      values.emplace_back();
    }
    const auto [frame, new_frame] = frame_index.emplace(name, report.frames.size());
    if (new_frame) {
      report.frames.push_back(name);
      frame_times.emplace_back(std::numeric_limits<double>::max(), 0.0);
    }
    const auto ms = [&](std::int64_t utime) { return static_cast<double>(utime - first) / 1000.0; };
    const TimelineSpan span{frame->second,
                            stage->second,
                            ms(timing.received_utime),
                            ms(timing.started_utime),
                            ms(timing.finished_utime),
                            ms(timing.published_utime),
                            timing.status_code};
    report.spans.push_back(span);
    auto& of_stage = values[stage->second];
    of_stage.wait.push_back(span.started - span.received);
    of_stage.work.push_back(span.finished - span.started);
    of_stage.cpu.push_back(static_cast<double>(timing.cpu_us) / 1000.0);
    auto& [begin, end] = frame_times[frame->second];
    begin = std::min(begin, span.received);
    end = std::max(end, span.published);
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    report.stages[i].frames = values[i].work.size();
    report.stages[i].wait = quantiles(values[i].wait);
    report.stages[i].work = quantiles(values[i].work);
    report.stages[i].cpu = quantiles(values[i].cpu);
  }
  std::vector<double> end_to_end;
  for (const auto& [begin, end] : frame_times) end_to_end.push_back(end - begin);
  report.end_to_end = quantiles(end_to_end);
  if (last > first)
    report.frames_per_second =
        static_cast<double>(report.frames.size()) / (static_cast<double>(last - first) * 1e-6);
  return report;
}

std::string to_text(const TimingReport& report) {
  std::size_t width = 10;
  for (const auto& stage : report.stages) width = std::max(width, stage.stage.size());
  std::string text =
      fmt::format("{:<{}}          queue wait, ms                      work, ms\n", "", width);
  text += fmt::format("{:<{}} {:>7}{:>8}{:>8}{:>8}  {:>8}{:>8}{:>8}{:>8}  {:>8}  {:>6}\n", "stage",
                      width, "p50", "p95", "p99", "max", "p50", "p95", "p99", "max", "cpu p50",
                      "frames");
  for (const auto& stage : report.stages) {
    text += fmt::format(
        "{:<{}} {:>7.1f}{:>8.1f}{:>8.1f}{:>8.1f}  {:>8.1f}{:>8.1f}{:>8.1f}{:>8.1f}  {:>8.1f}  "
        "{:>6}\n",
        stage.stage, width, stage.wait.p50, stage.wait.p95, stage.wait.p99, stage.wait.max,
        stage.work.p50, stage.work.p95, stage.work.p99, stage.work.max, stage.cpu.p50,
        stage.frames);
  }
  const auto& all = report.end_to_end;
  text +=
      fmt::format("{:<{}} {:>31}  {:>8.1f}{:>8.1f}{:>8.1f}{:>8.1f}  {:>8}  {:>6}\n", "end to end",
                  width, "", all.p50, all.p95, all.p99, all.max, "", report.frames.size());
  text += fmt::format("throughput {:.1f} frames/s\n", report.frames_per_second);
  return text;
}

std::string to_json(const TimingReport& report) {
  nlohmann::ordered_json json;
  const auto put = [](nlohmann::ordered_json& at, const std::string& prefix, const Quantiles& q) {
    at[prefix + "p50_ms"] = q.p50;
    at[prefix + "p95_ms"] = q.p95;
    at[prefix + "p99_ms"] = q.p99;
    at[prefix + "max_ms"] = q.max;
  };
  json["frames"] = report.frames.size();
  json["frames_per_second"] = report.frames_per_second;
  put(json["end_to_end"], "", report.end_to_end);
  json["stages"] = nlohmann::ordered_json::object();
  for (const auto& stage : report.stages) {
    auto& at = json["stages"][stage.stage];
    at["frames"] = stage.frames;
    put(at, "", stage.work);
    put(at, "wait_", stage.wait);
    put(at, "cpu_", stage.cpu);
  }
  return json.dump(2);
}

}  // namespace weft
