#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "stage/clock.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/keys.hpp"
#include "tools/weft/run_folder.hpp"
#include "tools/weft/spy.hpp"

namespace weft {
namespace {

using std::chrono::milliseconds;

/// A screen of its own; what was there is back when this ends.
class Screen {
 public:
  Screen() { std::fputs("\033[?1049h\033[?25l", stdout); }
  ~Screen() {
    std::fputs("\033[?25h\033[?1049l", stdout);
    std::fflush(stdout);
  }
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  static void show(const std::vector<std::string>& lines, std::size_t marked) {
    winsize size{};
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_row == 0 || size.ws_col == 0)
      size = {24, 80, 0, 0};
    std::string screen = "\033[H";
    for (std::size_t i = 0; i < std::min<std::size_t>(lines.size(), size.ws_row - 1u); ++i) {
      std::string line = lines[i].substr(0, size.ws_col);
      // What a message says must not command the terminal.
      std::replace_if(
          line.begin(), line.end(), [](char c) { return static_cast<unsigned char>(c) < ' '; },
          '?');
      screen += (i == marked ? "\033[7m" + line + "\033[0m" : line) + "\033[K\n";
    }
    std::fputs((screen + "\033[J").c_str(), stdout);
    std::fflush(stdout);
  }
};

nlohmann::ordered_json to_json(const std::vector<SpyRow>& rows, const SpyTable& table,
                               double seconds) {
  nlohmann::ordered_json json{{"seconds", seconds}};
  json["channels"] = nlohmann::ordered_json::object();
  for (const auto& row : rows) {
    json["channels"][row.channel] = {{"type", row.type},
                                     {"messages", row.messages},
                                     {"bytes", row.bytes},
                                     {"per_second", row.per_second},
                                     {"bytes_per_second", row.bytes_per_second},
                                     {"age_s", row.age_s},
                                     {"longest_gap_s", row.longest_gap_s},
                                     {"missing", row.missing},
                                     {"not_ok", row.not_ok},
                                     {"damaged", row.damaged},
                                     {"newest", table.fields(row.channel)}};
  }
  return json;
}

void watch(Bus& bus, SpyTable& table, const std::string& where, double duration_s,
           std::int64_t start_us) {
  constexpr double kWindow_s = 3;
  Keys keys;
  const Screen screen;
  std::size_t chosen = 0;
  bool open = false;
  std::int64_t drawn_us = 0;
  while (!stop_requested()) {
    if (const auto message = bus.receive(milliseconds(50))) table.add(*message, stage::now_us());
    const auto now = stage::now_us();
    if (duration_s > 0 && static_cast<double>(now - start_us) * 1e-6 > duration_s) break;
    const char key = keys.next();
    if (key == 'q' || key == Keys::kEnd) break;
    if (key == 0 && now - drawn_us < 300'000) continue;
    drawn_us = now;
    const auto rows = table.rows(now, kWindow_s);
    if (key == 'j' && chosen + 1 < rows.size()) ++chosen;
    if (key == 'k' && chosen > 0) --chosen;
    if (key == '\n' || key == ' ') open = !open;
    std::vector<std::string> lines{where + "   up, down: channel   Enter: fields   q: end", ""};
    const auto text = to_text(rows);
    for (std::size_t begin = 0; begin < text.size(); begin = text.find('\n', begin) + 1)
      lines.push_back(text.substr(begin, text.find('\n', begin) - begin));
    const auto marked = chosen + 3;
    if (open && chosen < rows.size()) {
      lines.emplace_back();
      for (const auto& line : table.fields(rows[chosen].channel)) lines.push_back(line);
    }
    Screen::show(lines, marked);
  }
}

}  // namespace

stage::LcmUrl url_to_hear(const std::string& url, const std::string& set) {
  if (!url.empty()) return stage::LcmUrl::parse(url);
  if (!set.empty() && std::filesystem::is_regular_file(set))
    return url_of(ProcessSet::from_file(set));
  if (!set.empty()) return stage::LcmUrl::parse(RunFolder::find(set).url());
  return stage::LcmUrl::parse("");
}

int spy_command(const SpyOptions& options) {
  catch_stop_signals();
  MessageTypes types = MessageTypes::built_in();
  if (!options.types.empty()) types.add_folder(options.types);
  const auto url = url_to_hear(options.url, options.set);
  const auto bus = make_lcm_bus(url, options.channels);
  SpyTable table(types);
  const auto start = stage::now_us();
  const bool terminal = isatty(STDOUT_FILENO) != 0 && isatty(STDIN_FILENO) != 0;
  const bool screen = terminal && options.show.empty() && options.json.empty();
  const double duration_s = options.duration_s > 0 ? options.duration_s : screen ? 0 : 5;
  if (screen) {
    watch(*bus, table, url.to_string(), duration_s, start);
  } else {
    fmt::print("listening to {} for {} s\n", url.to_string(), duration_s);
    std::fflush(stdout);
    const auto end = start + static_cast<std::int64_t>(duration_s * 1e6);
    while (!stop_requested() && stage::now_us() < end) {
      if (const auto message = bus->receive(milliseconds(50))) table.add(*message, stage::now_us());
    }
  }
  const auto now = stage::now_us();
  const double seconds = static_cast<double>(now - start) * 1e-6;
  const auto rows = table.rows(now, seconds);
  fmt::print("{}", to_text(rows));
  for (const auto& channel : options.show) {
    fmt::print("\n{}: ", channel);
    for (const auto& line : table.fields(channel)) fmt::print("{}\n", line);
  }
  if (!options.json.empty())
    write_text_file(options.json, to_json(rows, table, seconds).dump(2) + "\n");
  if (rows.empty()) {
    fmt::print(stderr,
               "nothing was heard: is a set running (weft status), with this URL and in this "
               "network namespace?\n");
  }
  return rows.empty() ? 1 : 0;
}

}  // namespace weft
