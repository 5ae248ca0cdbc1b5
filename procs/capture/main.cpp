#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <thread>

#include "procs/capture/log.hpp"
#include "procs/capture/source.hpp"

namespace weft::capture_process {
namespace {

/// Turns SIGINT and SIGTERM into a stop request. To be made before any other thread.
class StopSignals {
 public:
  StopSignals() {
    sigemptyset(&signals_);
    for (const int signal : {SIGINT, SIGTERM}) sigaddset(&signals_, signal);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    waiter_ = std::jthread([this](const std::stop_token& done) {
      constexpr timespec kWait = {0, 100'000'000};
      while (!done.stop_requested())
        if (sigtimedwait(&signals_, nullptr, &kWait) > 0) stop_.request_stop();
    });
  }
  std::stop_token token() const { return stop_.get_token(); }

 private:
  sigset_t signals_;
  std::stop_source stop_;
  std::jthread waiter_;
};

/// Settings under names of their own, for the command line.
struct Shortcuts {
  std::vector<std::pair<std::string, std::string>> values;
  std::vector<std::string> assignments;

  void add_to(CLI::App& app) {
    const auto option = [&](const char* name, const char* key, const char* doc) {
      return app.add_option_function<std::string>(
          name, [this, key](const std::string& value) { values.emplace_back(key, value); }, doc);
    };
    option("--dataset", "dataset",
           "folder of scans (IRI layout, CTU, image pairs, organised PCDs), or a recording of a "
           "moving camera (TUM, cube_slam, 7-Scenes, ICL-NUIM)");
    option("--format", "format", "auto, tum, cube_slam, 7scenes, icl, or pairs for single scans");
    option("--colour", "colour", "colour image of one pair");
    option("--depth", "depth", "depth image of one pair");
    option("--pcd", "pcd", "one organised cloud");
    option("--device", "device", "OpenNI2 camera: any, its URI, or an .oni recording");
    option("--loop", "loop", "how often the scans are shown; 0: without end");
    option("--rotations", "views.rotations", "show each scan in so many rotations");
    app.add_flag_callback(
        "--mirror", [this] { values.emplace_back("views.mirror", "true"); },
        "show each rotation mirrored, too");
  }
  /// "key=value" as --set takes it: quoted, since a path may look like something else in YAML.
  std::vector<std::string> settings() const {
    std::vector<std::string> result;
    for (const auto& [key, value] : values) {
      std::string quoted;
      for (const char c : value) quoted += c == '\'' ? std::string("''") : std::string(1, c);
      const bool text = key.find('.') == std::string::npos && key != "loop";
      result.push_back(key + "=" + (text ? "'" + quoted + "'" : value));
    }
    return result;
  }
};

int capture_log(const Settings& settings, const std::string& out, LogOptions options,
                bool has_session) {
  const StopSignals stop_signals;
  const auto source = make_source(settings);
  if (!has_session) options.session = source->default_session();
  const long total = options.count > 0 && source->frame_count() > 0
                         ? std::min(options.count, source->frame_count())
                         : std::max(options.count, source->frame_count());
  if (total == 0)
    fmt::print(stderr, "weft-capture: the source has no end: stop with Ctrl-C, or give --count\n");
  using Clock = std::chrono::steady_clock;
  const auto started = Clock::now();
  auto shown = started;
  const bool terminal = isatty(STDERR_FILENO) == 1;
  std::size_t errors = 0;
  const auto result = write_log(
      *source, out, options,
      [&](const LogResult& so_far) {
        for (; errors < so_far.errors.size(); ++errors)
          fmt::print(stderr, "{}weft-capture: {}\n", terminal ? "\r" : "", so_far.errors[errors]);
        const auto now = Clock::now();
        if (now - shown < std::chrono::seconds(terminal ? 1 : 10)) return;
        shown = now;
        const double rate = static_cast<double>(so_far.frames) /
                            std::chrono::duration<double>(now - started).count();
        fmt::print(stderr, "{}{} / {} frames, {:.1f} a second, {:.0f} s left{}",
                   terminal ? "\r" : "", so_far.frames, total ? std::to_string(total) : "?", rate,
                   total ? static_cast<double>(total - so_far.frames) / rate : 0.0,
                   terminal ? "   " : "\n");
      },
      stop_signals.token());
  fmt::print(stderr, "{}{}: {} frames, {} of them failed, {} messages, {:.1f} MB\n",
             terminal ? "\r" : "", out, result.frames, result.errors.size(), result.messages,
             static_cast<double>(result.bytes) / 1e6);
  return result.errors.empty() && result.frames > 0 ? 0 : 1;
}

int run(int argc, char** argv) {
  CLI::App app(
      "Colour and depth from a camera, a recording or scans: as RGBD_FRAME messages, or with --out "
      "as a log.",
      "weft-capture");
  app.allow_extras();
  app.set_help_flag("");
  bool help = false;
  app.add_flag("-h,--help", help, "print this help");
  Shortcuts shortcuts;
  shortcuts.add_to(app);
  std::string out, settings_file;
  LogOptions options;
  app.add_option("--out", out, "write this log instead of sending messages");
  std::vector<std::string> assignments;
  app.add_option("--settings", settings_file, "YAML file with the settings")->type_name("FILE");
  app.add_option("--set", assignments, "one setting, over those of the file; may be repeated")
      ->type_name("KEY=VALUE");
  auto* rate = app.add_option("--rate", options.rate_hz,
                              "frames a second; a log's default is 10, a camera has its own");
  auto* count = app.add_option("--count", options.count, "frames in all; 0: until the source ends");
  auto* camera = app.add_option("--camera", options.camera, "name of the camera");
  auto* session = app.add_option("--session", options.session, "number of the capture session");
  for (auto* option : {rate, count}) option->check(CLI::NonNegativeNumber);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    app.exit(e);
    return 2;
  }
  for (const std::string& each : shortcuts.settings()) assignments.push_back(each);

  if (out.empty()) {
    std::vector<std::string> arguments = {argv[0]};
    const auto add = [&](const std::string& name, const std::string& value) {
      arguments.push_back(name);
      arguments.push_back(value);
    };
    if (help) {
      fmt::print("{}\nWithout --out, also:\n\n", app.help());
      arguments.push_back("--help");
    }
    if (!settings_file.empty()) add("--settings", settings_file);
    for (const std::string& each : assignments) add("--set", each);
    if (rate->count()) add("--rate", fmt::format("{}", options.rate_hz));
    if (count->count()) add("--count", std::to_string(options.count));
    if (camera->count()) add("--camera", options.camera);
    if (session->count()) add("--session", std::to_string(options.session));
    for (const std::string& each : app.remaining()) arguments.push_back(each);
    std::fflush(stdout);
    std::vector<char*> pointers;
    for (std::string& each : arguments) pointers.push_back(each.data());
    return stage::run_source(
        static_cast<int>(pointers.size()), pointers.data(), "weft-capture",
        "Sends colour and depth as RGBD_FRAME messages.",
        [](const Settings& settings) { return make_source(settings); }, settings_reference());
  }

  if (help) {
    fmt::print("{}", app.help());
    return 0;
  }
  if (!app.remaining().empty()) {
    fmt::print(stderr, "weft-capture: {} means nothing with --out; see --help\n",
               app.remaining().front());
    return 2;
  }
  try {
    Settings settings = settings_file.empty() ? Settings::empty("weft-capture")
                                              : Settings::from_file(settings_file);
    for (const std::string& each : assignments) settings.set(each);
    return capture_log(settings, out, options, session->count() > 0);
  } catch (const std::exception& e) {
    fmt::print(stderr, "weft-capture: {}\n", e.what());
    return 1;
  }
}

}  // namespace
}  // namespace weft::capture_process

int main(int argc, char** argv) { return weft::capture_process::run(argc, argv); }
