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
  const auto four = [](const Quantiles& q) { return nlohmann::json{q.p50, q.p95, q.p99, q.max}; };
  nlohmann::json json{{"frames", report.frames.size()},
                      {"frames_per_second", report.frames_per_second},
                      {"end_to_end", four(report.end_to_end)},
                      {"initial_ms", std::max(50.0, report.end_to_end.p50 * 4)},
                      {"stages", nlohmann::json::array()},
                      {"spans", nlohmann::json::array()}};
  for (const auto& stage : report.stages) {
    json["stages"].push_back({{"name", stage.stage},
                              {"wait", four(stage.wait)},
                              {"work", four(stage.work)},
                              {"cpu", four(stage.cpu)},
                              {"frames", stage.frames}});
  }
  for (const auto& span : report.spans) {
    json["spans"].push_back({span.frame, span.stage, span.received, span.started, span.finished,
                             span.published, span.status_code});
  }
  return json;
}

}  // namespace weft
