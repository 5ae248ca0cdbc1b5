#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/clock.hpp"
#include "stage/log.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/spy.hpp"

namespace weft {

/// Unlike the logs that other commands write, this one is in its place from the first event on, and
/// handed to the system every second: whatever ends the recording, what came before can be read.
int record_command(const RecordOptions& options) {
  namespace fs = std::filesystem;
  using std::chrono::milliseconds;
  catch_stop_signals();
  if (fs::exists(options.out))
    throw Error(options.out + " is there already; a recording replaces nothing, give another name");
  const auto url = url_to_hear(options.url, options.set);
  const auto bus = make_lcm_bus(url, options.channels);
  if (const auto folder = fs::path(options.out).parent_path(); !folder.empty())
    fs::create_directories(folder);
  stage::LogWriter log(options.out);
  const auto types = MessageTypes::built_in();
  SpyTable table(types);
  const auto start = stage::now_us();
  const auto end = options.duration_s > 0
                       ? start + static_cast<std::int64_t>(options.duration_s * 1e6)
                       : std::numeric_limits<std::int64_t>::max();
  const bool terminal = isatty(STDERR_FILENO) != 0;
  fmt::print(
      stderr, "recording {} to {}{}\n", url.to_string(), options.out,
      options.duration_s > 0 ? fmt::format(" for {} s", options.duration_s) : "; Ctrl-C ends it");
  std::int64_t events = 0, left_out = 0, flushed = start, shown = start;
  const auto state = [&](std::int64_t now) {
    return fmt::format("{} events, {:.1f} MB, {:.0f} s", events,
                       static_cast<double>(log.bytes()) / 1e6,
                       static_cast<double>(now - start) / 1e6);
  };
  std::string fault;
  try {
    while (!stop_requested() && stage::now_us() < end) {
      const auto message = bus->receive(milliseconds(50));
      const auto now = stage::now_us();
      if (message) table.add(*message, now);
      if (message && !plain_channel(message->channel)) {
        ++left_out;
      } else if (message) {
        log.write(now, message->channel, message->data);
        ++events;
      }
      if (now - flushed > 1'000'000) {
        log.flush();
        flushed = now;
      }
      if (now - shown > (terminal ? 1'000'000 : 10'000'000)) {
        fmt::print(stderr, "{}{}{}", terminal ? "\r\033[K" : "", state(now), terminal ? "" : "\n");
        shown = now;
      }
    }
    log.close();
  } catch (const Error& e) {
    fault = e.what();
    // At once, before anything else is done.
    fmt::print(stderr, "{}weft: {}\n", terminal ? "\n" : "", fault);
  }
  const auto now = stage::now_us();
  const auto rows = table.rows(now, static_cast<double>(now - start) * 1e-6);
  fmt::print("{}{}\n{}", terminal ? "\n" : "", state(now), to_text(rows));
  if (!options.json.empty()) {
    nlohmann::ordered_json json{{"events", events}, {"error", fault}};
    json["channels"] = nlohmann::ordered_json::object();
    for (const auto& row : rows)
      json["channels"][row.channel] = {{"messages", row.messages}, {"missing", row.missing}};
    write_text_file(options.json, json.dump(2) + "\n");
  }
  if (left_out > 0)
    fmt::print("left out: {} messages whose channel's name no log can hold\n", left_out);
  if (events == 0) {
    fmt::print(stderr,
               "nothing was heard: is a set running (weft status), with this URL and in this "
               "network namespace?\n");
  }
  return fault.empty() && events > 0 ? 0 : 1;
}

}  // namespace weft
