#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/clock.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/doctor.hpp"
#include "tools/weft/message.hpp"

namespace weft {

int doctor_command(const DoctorOptions& options, const StageRegistry& registry) {
  using Kind = Finding::Kind;
  char host[256] = {};
  gethostname(host, sizeof host - 1);
  stage::LcmUrl url = stage::LcmUrl::parse("");
  std::vector<Finding> findings;
  if (!options.set.empty()) {
    const auto set = ProcessSet::from_file(options.set);
    url = url_of(set);
    findings = check_set(set, registry, host);
  }
  for (auto& finding : check_machine(url, options.folder)) findings.push_back(std::move(finding));
  std::map<std::pair<std::string, std::string>, weft::stage_status_t> heard;  // stage, process
  std::map<std::string, HostClock> clocks;
  try {
    const auto bus = make_lcm_bus(url, stage::kStatusChannel);
    const auto end = std::chrono::steady_clock::now() +
                     std::chrono::milliseconds(static_cast<std::int64_t>(options.listen_s * 1000));
    while (std::chrono::steady_clock::now() < end) {
      const auto message = bus->receive(std::chrono::milliseconds(50));
      if (!message) continue;
      const auto now = stage::now_us();
      const auto status = decode_message<weft::stage_status_t>(message->data);
      if (!status) continue;
      heard[{status->stage, status->host + std::to_string(status->pid)}] = *status;
      if (status->host == host) continue;
      const auto late = now - status->header.utime;
      auto [clock, is_new] = clocks.try_emplace(status->host, HostClock{status->host, late});
      clock->second.arrived_minus_sent_us = std::min(clock->second.arrived_minus_sent_us, late);
    }
  } catch (const Error&) {
    // check_machine has said so.
  }
  std::vector<weft::stage_status_t> statuses;
  for (const auto& [key, status] : heard) statuses.push_back(status);
  findings.push_back({Kind::kGood,
                      fmt::format("{} stages were heard in {} s", heard.size(), options.listen_s),
                      ""});
  for (auto& finding : mixed_versions(statuses)) findings.push_back(std::move(finding));
  for (const auto& [name, clock] : clocks) findings.push_back(judge_clock(clock));

  bool all_well = true;
  auto json = nlohmann::ordered_json::array();
  for (const auto& finding : findings) {
    const char* kind = finding.kind == Kind::kGood      ? "good"
                       : finding.kind == Kind::kWarning ? "warning"
                                                        : "bad";
    all_well = all_well && finding.kind != Kind::kBad;
    fmt::print("{:<8} {}\n", kind, finding.what);
    if (!finding.remedy.empty()) fmt::print("         remedy: {}\n", finding.remedy);
    json.push_back({{"kind", kind}, {"what", finding.what}, {"remedy", finding.remedy}});
  }
  if (!options.json.empty()) write_text_file(options.json, json.dump(2) + "\n");
  return all_well ? 0 : 1;
}

}  // namespace weft
