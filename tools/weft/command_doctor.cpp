#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/clock.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/doctor.hpp"
#include "tools/weft/message.hpp"
#include "weft/clock_pong_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {

int doctor_command(const DoctorOptions& options, const StageRegistry& registry) {
  using Kind = Finding::Kind;
  char host[256] = {};
  gethostname(host, sizeof host - 1);
  stage::LcmUrl url = stage::LcmUrl::parse("");
  std::optional<ProcessSet> set;
  if (!options.set.empty()) {
    set = ProcessSet::from_file(options.set);
    url = url_of(*set);
  }
  std::map<std::pair<std::string, std::string>, weft::stage_status_t> heard;  // stage, process
  std::set<std::string> hosts;
  ClockExchange clocks(stage::now_us() ^ getpid());
  double bytes = 0;
  try {
    const auto bus = make_lcm_bus(url, "STAGE_STATUS|STAGE_TIMING|CLOCK_PONG");
    using std::chrono::milliseconds;
    const auto begin = std::chrono::steady_clock::now();
    auto ask = begin;
    while (std::chrono::steady_clock::now() - begin <
           milliseconds(static_cast<std::int64_t>(options.listen_s * 1000))) {
      constexpr milliseconds kBetweenQuestions{100};
      if (std::chrono::steady_clock::now() >= ask) {
        ask += kBetweenQuestions;
        bus->publish(stage::kPingChannel, encode_message(clocks.question(stage::now_us())));
      }
      const auto message = bus->receive(milliseconds(20));
      const auto now = stage::now_us();
      if (!message) continue;
      if (message->channel == stage::kPongChannel) {
        if (const auto pong = decode_message<weft::clock_pong_t>(message->data))
          clocks.take(*pong, now);
      } else if (message->channel == stage::kTimingChannel) {
        if (const auto timing = decode_message<weft::stage_timing_t>(message->data))
          bytes += timing->output_bytes;
      } else if (const auto status = decode_message<weft::stage_status_t>(message->data)) {
        heard[{status->stage, status->host + std::to_string(status->pid)}] = *status;
        hosts.insert(status->host);
      }
    }
  } catch (const Error&) {
    // check_machine says why.
  }
  std::vector<weft::stage_status_t> statuses;
  std::set<std::string> running;
  for (const auto& [key, status] : heard) {
    statuses.push_back(status);
    if (status.host == host) running.insert(status.stage);
  }
  std::vector<Finding> findings;
  if (set) findings = check_set(*set, registry, host, running);
  for (auto& finding :
       check_machine(url, options.folder, options.listen_s > 0 ? bytes / options.listen_s : 0))
    findings.push_back(std::move(finding));
  findings.push_back({Kind::kGood,
                      fmt::format("{} stages were heard in {} s", heard.size(), options.listen_s),
                      ""});
  for (auto& finding : mixed_versions(statuses)) findings.push_back(std::move(finding));
  if (set) {
    for (auto& finding : differences_from_files(*set, registry, statuses))
      findings.push_back(std::move(finding));
    for (auto& finding : silent_hosts(*set, host, statuses)) findings.push_back(std::move(finding));
  }
  for (auto& finding : clocks.findings(host, hosts)) findings.push_back(std::move(finding));

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
