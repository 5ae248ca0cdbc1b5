#include "tools/weft/page.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace weft {

std::string make_page(const std::string& name, const nlohmann::json& data) {
  // No "</script>" may stand in the data.
  std::string data_text;
  for (const char c : data.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace))
    data_text += c == '<' ? std::string("\\u003c") : std::string(1, c);
  const auto& files = internal::page_files();
  std::string out;
  const std::string& page = files.at(name);
  for (std::size_t at = 0; at < page.size();) {
    const auto open = page.find("{{", at);
    out += page.substr(at, open - at);
    if (open == std::string::npos) break;
    const auto close = page.find("}}", open);
    const auto what = page.substr(open + 2, close - open - 2);
    out += what == "data" ? data_text : files.at(what);
    at = close + 2;
  }
  return out;
}

nlohmann::json page_timing(const TimingReport& report) {
  constexpr std::size_t kMostFrames = 3000, kSlowest = 12;
  const auto four = [](const Quantiles& q) { return nlohmann::json{q.p50, q.p95, q.p99, q.max}; };
  nlohmann::json json{{"frames", report.frames.size()},
                      {"frames_per_second", report.frames_per_second},
                      {"end_to_end", four(report.end_to_end)},
                      {"transport", four(report.transport)},
                      {"initial_ms", std::max(50.0, report.end_to_end.p50 * 4)},
                      {"frames_shown", std::min(report.frames.size(), kMostFrames)},
                      {"stages", nlohmann::json::array()},
                      {"spans", nlohmann::json::array()},
                      {"slowest", nlohmann::json::array()}};
  for (const auto& stage : report.stages) {
    json["stages"].push_back({{"name", stage.stage},
                              {"host", stage.host},
                              {"wait", four(stage.wait)},
                              {"work", four(stage.work)},
                              {"publish", four(stage.publish)},
                              {"cpu", four(stage.cpu)},
                              {"frames", stage.frames},
                              {"failed", stage.failed},
                              {"dropped", stage.dropped},
                              {"missing_input", stage.missing_input},
                              {"gaps", stage.gaps},
                              {"critical_frames", stage.critical_frames},
                              {"critical_ms", stage.critical_ms}});
  }
  for (const auto& span : report.spans) {
    if (span.frame >= kMostFrames) continue;
    json["spans"].push_back({span.frame, span.stage, span.received, span.started, span.finished,
                             span.published, span.status_code, span.critical ? 1 : 0});
  }
  std::vector<const CriticalPath*> paths;
  for (const auto& path : report.critical_paths) paths.push_back(&path);
  std::sort(paths.begin(), paths.end(),
            [](const auto* a, const auto* b) { return a->total > b->total; });
  paths.resize(std::min(paths.size(), kSlowest));
  for (const auto* path : paths) {
    nlohmann::json steps = nlohmann::json::array();
    for (const auto& step : path->steps) {
      const auto& span = report.spans[step.span];
      steps.push_back({span.stage, step.transport, span.started - span.received,
                       span.finished - span.started, std::max(0.0, step.publish)});
    }
    json["slowest"].push_back({{"frame", path->frame},
                               {"name", to_string(report.frames[path->frame])},
                               {"total", path->total},
                               {"begin", report.spans[path->steps.front().span].received},
                               {"steps", steps}});
  }
  return json;
}

}  // namespace weft
