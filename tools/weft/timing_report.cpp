#include "tools/weft/timing_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "stage/seq_set.hpp"
#include "weft/status_t.hpp"

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
  if (seen_.emplace(timing.stage, frame).second) timings_.push_back(timing);
}

void TimingCollector::add(const weft::stage_status_t& status) {
  auto& channels = channels_[status.stage];
  for (const auto& port : status.fingerprints) {
    if (port.direction > weft::type_fingerprint_t::OUTPUT) continue;  // nobody waits for feedback
    const bool output = port.direction == weft::type_fingerprint_t::OUTPUT;
    (output ? channels.outputs : channels.inputs).insert(port.channel);
  }
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
  report.first_utime = first;
  struct Values {
    std::vector<double> wait, work, publish, cpu;
    std::map<std::pair<std::string, std::int64_t>, stage::SeqSet> seqs;
  };
  std::vector<Values> values;
  std::vector<std::pair<double, double>> frame_times;
  std::vector<std::vector<std::size_t>> frame_spans;
  for (const auto& timing : timings_) {
    const FrameName name{timing.header.camera, timing.header.session, timing.header.seq};
    const auto [stage, new_stage] = stage_index.emplace(timing.stage, report.stages.size());
    if (new_stage) {
      report.stages.emplace_back();
      report.stages.back().stage = timing.stage;
      values.emplace_back();
    }
    auto& of_stage = report.stages[stage->second];
    of_stage.host = timing.host;
    const auto [frame, new_frame] = frame_index.emplace(name, report.frames.size());
    if (new_frame) {
      report.frames.push_back(name);
      frame_times.emplace_back(std::numeric_limits<double>::max(), 0.0);
      frame_spans.emplace_back();
    }
    const auto ms = [&](std::int64_t utime) { return static_cast<double>(utime - first) / 1000.0; };
    const TimelineSpan span{frame->second,
                            stage->second,
                            ms(timing.received_utime),
                            ms(timing.started_utime),
                            ms(timing.finished_utime),
                            ms(timing.published_utime),
                            static_cast<double>(timing.cpu_us) / 1000.0,
                            timing.queue_length,
                            timing.status_code,
                            false};
    frame_spans[frame->second].push_back(report.spans.size());
    report.spans.push_back(span);
    auto& all = values[stage->second];
    all.wait.push_back(span.started - span.received);
    all.work.push_back(span.finished - span.started);
    all.publish.push_back(span.published - span.finished);
    all.cpu.push_back(span.cpu);
    if (name.seq >= 0) all.seqs[{name.camera, name.session}].insert(name.seq);
    of_stage.failed += timing.status_code == weft::status_t::FAILED;
    of_stage.dropped += timing.status_code == weft::status_t::DROPPED;
    of_stage.missing_input += timing.status_code == weft::status_t::MISSING_INPUT;
    auto& [begin, end] = frame_times[frame->second];
    begin = std::min(begin, span.received);
    end = std::max(end, span.published);
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    auto& of_stage = report.stages[i];
    of_stage.frames = values[i].work.size();
    of_stage.wait = quantiles(values[i].wait);
    of_stage.work = quantiles(values[i].work);
    of_stage.publish = quantiles(values[i].publish);
    of_stage.cpu = quantiles(values[i].cpu);
    for (const auto& [session, seqs] : values[i].seqs) of_stage.gaps += seqs.missing();
  }
  std::vector<double> end_to_end, transport;
  for (std::size_t i = 0; i < frame_times.size(); ++i) {
    end_to_end.push_back(frame_times[i].second - frame_times[i].first);
    report.critical_paths.push_back(critical_path(report, frame_spans[i]));
    const auto& path = report.critical_paths.back();
    for (const auto& step : path.steps) {
      auto& span = report.spans[step.span];
      auto& of_stage = report.stages[span.stage];
      span.critical = true;
      ++of_stage.critical_frames;
      of_stage.critical_ms += step.transport + span.finished - span.received + step.publish;
      if (&step != &path.steps.front()) transport.push_back(step.transport);
    }
  }
  for (auto& of_stage : report.stages) {
    if (of_stage.critical_frames > 0)
      of_stage.critical_ms /= static_cast<double>(of_stage.critical_frames);
  }
  report.transport = quantiles(transport);
  report.end_to_end = quantiles(end_to_end);
  if (last > first)
    report.frames_per_second =
        static_cast<double>(report.frames.size()) / (static_cast<double>(last - first) * 1e-6);
  return report;
}

CriticalPath TimingCollector::critical_path(const TimingReport& report,
                                            const std::vector<std::size_t>& spans) const {
  constexpr double kClock_ms = 0.5;  // a message may seem to arrive before it was sent
  const auto& all = report.spans;
  const auto reads_from = [&](std::size_t stage, std::size_t other) {
    const auto reader = channels_.find(report.stages[stage].stage);
    const auto writer = channels_.find(report.stages[other].stage);
    if (reader == channels_.end() || writer == channels_.end()) return true;
    return std::any_of(
        reader->second.inputs.begin(), reader->second.inputs.end(),
        [&](const std::string& input) { return writer->second.outputs.contains(input); });
  };
  CriticalPath path;
  std::size_t at = *std::max_element(spans.begin(), spans.end(), [&](auto a, auto b) {
    return all[a].published < all[b].published;
  });
  path.frame = all[at].frame;
  std::set<std::size_t> used{at};
  path.steps.push_back({at, 0, all[at].published - all[at].finished});
  for (;;) {
    std::optional<std::size_t> before;
    for (const auto other : spans) {
      // Not `published`: a message arrives while its sender is still at it.
      if (used.contains(other) || all[other].finished > all[at].received + kClock_ms ||
          !reads_from(all[at].stage, all[other].stage))
        continue;
      if (!before || all[other].finished > all[*before].finished) before = other;
    }
    if (!before) break;
    const auto handed_over = std::min(all[*before].published, all[at].received);
    path.steps.back().transport = all[at].received - handed_over;
    path.steps.push_back({*before, 0, handed_over - all[*before].finished});
    at = *before;
    used.insert(at);
  }
  std::reverse(path.steps.begin(), path.steps.end());
  path.total = all[path.steps.back().span].published - all[path.steps.front().span].received;
  return path;
}

std::string to_text(const TimingReport& report) {
  std::size_t width = 10;
  for (const auto& stage : report.stages) width = std::max(width, stage.stage.size());
  std::string text = fmt::format("{:<{}} {:^31}  {:^32}  {:>8}{:>8}  {:>6}\n", "stage, ms", width,
                                 "---------- queue wait ---------",
                                 "------------- work -------------", "CPU", "publish", "");
  text += fmt::format("{:<{}} {:>7}{:>8}{:>8}{:>8}  {:>8}{:>8}{:>8}{:>8}  {:>8}{:>8}  {:>6}\n", "",
                      width, "p50", "p95", "p99", "max", "p50", "p95", "p99", "max", "p50", "p50",
                      "frames");
  for (const auto& stage : report.stages) {
    text += fmt::format(
        "{:<{}} {:>7.1f}{:>8.1f}{:>8.1f}{:>8.1f}  {:>8.1f}{:>8.1f}{:>8.1f}{:>8.1f}  {:>8.1f}"
        "{:>8.1f}  {:>6}\n",
        stage.stage, width, stage.wait.p50, stage.wait.p95, stage.wait.p99, stage.wait.max,
        stage.work.p50, stage.work.p95, stage.work.p99, stage.work.max, stage.cpu.p50,
        stage.publish.p50, stage.frames);
  }
  const auto& all = report.end_to_end;
  text +=
      fmt::format("{:<{}} {:>31}  {:>8.1f}{:>8.1f}{:>8.1f}{:>8.1f}  {:>16}  {:>6}\n", "end to end",
                  width, "", all.p50, all.p95, all.p99, all.max, "", report.frames.size());
  text += fmt::format("throughput {:.1f} frames/s\n\n", report.frames_per_second);
  text += fmt::format("{:<{}} {:>8}{:>8}{:>15}{:>6}   {}\n", "stage", width, "failed", "dropped",
                      "missing input", "gaps", "on the critical path of, for, ms a frame");
  for (const auto& stage : report.stages) {
    text +=
        fmt::format("{:<{}} {:>8}{:>8}{:>15}{:>6}   {:>5.1f} % of frames {:>9.1f}\n", stage.stage,
                    width, stage.failed, stage.dropped, stage.missing_input, stage.gaps,
                    100.0 * static_cast<double>(stage.critical_frames) /
                        static_cast<double>(report.frames.size()),
                    stage.critical_ms);
  }
  text += fmt::format("between stages of the critical path: {:.1f} ms median, {:.1f} p95\n",
                      report.transport.p50, report.transport.p95);
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
  put(json["transport"], "", report.transport);
  json["stages"] = nlohmann::ordered_json::object();
  for (const auto& stage : report.stages) {
    auto& at = json["stages"][stage.stage];
    at["host"] = stage.host;
    at["frames"] = stage.frames;
    put(at, "", stage.work);
    put(at, "wait_", stage.wait);
    put(at, "publish_", stage.publish);
    put(at, "cpu_", stage.cpu);
    at["failed"] = stage.failed;
    at["dropped"] = stage.dropped;
    at["missing_input"] = stage.missing_input;
    at["gaps"] = stage.gaps;
    at["critical_frames"] = stage.critical_frames;
    at["critical_ms"] = stage.critical_ms;
  }
  return json.dump(2);
}

std::string to_chrome_trace(const TimingReport& report) {
  using nlohmann::ordered_json;
  std::vector<std::string> hosts;
  const auto host_of = [&](std::size_t stage) {
    const auto& name = report.stages[stage].host;
    const auto at = std::find(hosts.begin(), hosts.end(), name);
    if (at != hosts.end()) return at - hosts.begin();
    hosts.push_back(name);
    return static_cast<std::ptrdiff_t>(hosts.size()) - 1;
  };
  auto events = ordered_json::array();
  for (std::size_t i = 0; i < report.stages.size(); ++i) {
    const auto host = host_of(i);
    events.push_back({{"ph", "M"},
                      {"name", "process_name"},
                      {"pid", host},
                      {"tid", i},
                      {"args", {{"name", "host " + report.stages[i].host}}}});
    events.push_back({{"ph", "M"},
                      {"name", "thread_name"},
                      {"pid", host},
                      {"tid", i},
                      {"args", {{"name", report.stages[i].stage}}}});
    events.push_back({{"ph", "M"},
                      {"name", "thread_sort_index"},
                      {"pid", host},
                      {"tid", i},
                      {"args", {{"sort_index", i}}}});
  }
  static const char* const kStatus[] = {"OK", "NOTHING", "FAILED", "DROPPED", "MISSING_INPUT"};
  for (std::size_t i = 0; i < report.spans.size(); ++i) {
    const auto& span = report.spans[i];
    const auto name = "frame " + to_string(report.frames[span.frame]);
    const auto host = host_of(span.stage);
    const bool known = span.status_code >= 0 && span.status_code < 5;
    events.push_back({{"ph", "X"},
                      {"cat", "work"},
                      {"name", name},
                      {"pid", host},
                      {"tid", span.stage},
                      {"ts", span.started * 1000},
                      {"dur", (span.finished - span.started) * 1000},
                      {"args",
                       {{"status", known ? kStatus[span.status_code] : "unknown"},
                        {"waited_ms", span.started - span.received},
                        {"cpu_ms", span.cpu},
                        {"publish_ms", span.published - span.finished},
                        {"queue_length", span.queue_length},
                        {"critical", span.critical}}}});
    // Frames wait side by side: as slices of one thread they would have to nest.
    if (span.started > span.received) {
      for (const char* phase : {"b", "e"})
        events.push_back({{"ph", phase},
                          {"cat", "queue"},
                          {"id", i},
                          {"pid", host},
                          {"tid", span.stage},
                          {"name", report.stages[span.stage].stage + " queue"},
                          {"ts", (*phase == 'b' ? span.received : span.started) * 1000}});
    }
  }
  std::size_t arrow = 0;
  for (const auto& path : report.critical_paths) {
    for (std::size_t k = 1; k < path.steps.size(); ++k, ++arrow) {
      const auto& from = report.spans[path.steps[k - 1].span];
      const auto& to = report.spans[path.steps[k].span];
      events.push_back({{"ph", "s"},
                        {"cat", "critical"},
                        {"name", "critical path"},
                        {"id", arrow},
                        {"pid", host_of(from.stage)},
                        {"tid", from.stage},
                        {"ts", from.finished * 1000}});
      events.push_back({{"ph", "f"},
                        {"bp", "e"},
                        {"cat", "critical"},
                        {"name", "critical path"},
                        {"id", arrow},
                        {"pid", host_of(to.stage)},
                        {"tid", to.stage},
                        {"ts", to.started * 1000}});
    }
  }
  const ordered_json trace{{"displayTimeUnit", "ms"}, {"traceEvents", std::move(events)}};
  return trace.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

}  // namespace weft
