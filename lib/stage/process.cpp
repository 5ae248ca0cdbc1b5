#include "stage/process.hpp"

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>

#include "base/hash.hpp"
#include "base/simd.hpp"
#include "stage/clock.hpp"
#include "stage/host.hpp"
#include "stage/source.hpp"
#include "stage/telemetry.hpp"

namespace weft::stage {
namespace {

/// What both kinds of process take from the command line.
struct Common {
  std::string settings_file;
  std::vector<std::string> assignments;
  std::vector<std::string> mappings;
  std::string name;
  std::string url;
  std::string log_level = "info";
  bool print_settings = false;
  bool check = false;

  void add_to(CLI::App& app) {
    app.add_option("--settings", settings_file, "YAML file with the settings")->type_name("FILE");
    app.add_option("--set", assignments, "one setting, over those of the file; may be repeated")
        ->type_name("KEY=VALUE");
    app.add_option("--name", name, "name of this instance in STAGE_TIMING and STAGE_STATUS");
    app.add_option("--map", mappings, "read or write CHANNEL under another name; may be repeated")
        ->type_name("CHANNEL=OTHER");
    app.add_option("--url", url,
                   "LCM URL; default $LCM_DEFAULT_URL or udpm://239.255.76.67:7667?ttl=0");
    app.add_option("--log-level", log_level, "trace, debug, info, warn, error")
        ->check(CLI::IsMember({"trace", "debug", "info", "warn", "error"}));
    app.add_flag("--print-settings", print_settings, "print every setting with its default");
    app.add_flag("--check", check, "read settings and models, print their hashes, and end");
    app.set_version_flag("--version", build_text());
  }

  /// Whether --check was given; then what it asks for is printed.
  bool checked(const Interface& interface) const {
    if (check)
      std::cout << "settings " << to_hex(interface.settings_hash) << "\nmodel "
                << to_hex(interface.model_hash) << std::endl;
    return check;
  }

  Settings settings(const std::string& program) const {
    Settings settings =
        settings_file.empty() ? Settings::empty(program) : Settings::from_file(settings_file);
    for (const std::string& assignment : assignments) settings.set(assignment);
    return settings;
  }

  ChannelMap channels() const {
    ChannelMap map;
    for (const std::string& mapping : mappings) add_mapping(map, mapping);
    return map;
  }

  LcmUrl connect_url() const {
    LcmUrl parsed = LcmUrl::parse(url);
    for (const std::string& warning : {receive_buffer_warning(parsed, receive_buffer_limit()),
                                       fragment_warning(parsed, FragmentMemory::of_kernel())}) {
      if (!warning.empty()) spdlog::warn("{}", warning);
    }
    return parsed;
  }
};

/// Parses, then runs body; turns what goes wrong into a line on stderr and an exit status.
int guarded(CLI::App& app, const Common& common, int argc, char** argv,
            const std::string& settings_reference, const std::function<void()>& body) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  if (common.print_settings) {
    std::cout << settings_reference;
    return std::cout.flush() ? 0 : 1;
  }
  const std::string title = common.name.empty() ? app.get_name() : common.name;
  spdlog::set_default_logger(spdlog::stderr_color_mt(title));
  spdlog::set_level(spdlog::level::from_str(common.log_level));
  spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %n[%P] %l: %v");
  try {
    block_stop_signals();
    body();
    return 0;
  } catch (const std::exception& e) {
    spdlog::error("{}", e.what());
    return 1;
  }
}

}  // namespace

int run_process(int argc, char** argv, const std::string& program, const std::string& summary,
                const StageFactory& factory, const std::string& settings_reference) {
  CLI::App app(summary, program);
  Common common;
  common.add_to(app);
  HostOptions options;
  options.runner.repeat_delay_us = 10'000;
  int deadline_ms = static_cast<int>(options.runner.deadline_us / 1000);
  app.add_flag("--lock-step", options.runner.lock_step,
               "no drops, no deadlines: a player waits for every answer");
  app.add_option("--queue", options.runner.queue_limit,
                 "live: frames that may wait before the oldest is dropped")
      ->check(CLI::Range(1, 10'000))
      ->capture_default_str();
  app.add_option("--deadline-ms", deadline_ms, "live: how long a frame waits for its inputs")
      ->check(CLI::Range(1, 3'600'000))
      ->capture_default_str();
  return guarded(app, common, argc, argv, settings_reference, [&] {
    options.name = common.name;
    options.runner.channels = common.channels();
    options.runner.deadline_us = std::int64_t{deadline_ms} * 1000;
    const auto stage = factory(common.settings(program));
    if (common.checked(stage->interface())) return;
    options.url = common.connect_url();
    Host host(*stage, options);
    spdlog::info("{} {} on {}, SIMD {}", program, build_text(), options.url.to_string(),
                 to_string(process_simd_path()));
    host.run();
    spdlog::info("stopped");
  });
}

int run_source(int argc, char** argv, const std::string& program, const std::string& summary,
               const SourceFactory& factory, const std::string& settings_reference) {
  CLI::App app(summary, program);
  Common common;
  common.add_to(app);
  SourceHostOptions options;
  std::string trigger = "continuous";
  auto* session = app.add_option("--session", options.source.session,
                                 "number of the capture session; default: the time of start");
  app.add_option("--camera", options.source.camera, "name of the camera")->capture_default_str();
  app.add_option("--rate", options.rate_hz, "frames a second; 0: as fast as the source gives them")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--count", options.count, "frames to publish; 0: until the source ends")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--part-pause-us", options.part_pause_us,
                 "pause after each part of a frame that does not fit one message")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  app.add_option("--trigger", trigger,
                 "continuous; single: one frame, then stop; message: one frame for each message on "
                 "CAPTURE_TRIGGER")
      ->check(CLI::IsMember({"continuous", "single", "message"}))
      ->capture_default_str();
  return guarded(app, common, argc, argv, settings_reference, [&] {
    options.name = common.name;
    options.source.channels = common.channels();
    if (session->count() == 0) options.source.session = now_us();
    if (trigger == "single") options.count = 1;
    options.on_trigger = trigger == "message";
    const auto source = factory(common.settings(program));
    if (common.checked(source->interface())) return;
    options.url = common.connect_url();
    SourceHost host(*source, options);
    spdlog::info("{} {} on {}, SIMD {}", program, build_text(), options.url.to_string(),
                 to_string(process_simd_path()));
    host.run();
    const Counters counters = host.counters();
    if (counters.frames_failed > 0) {
      throw Error(std::to_string(counters.frames_failed) + " of " +
                  std::to_string(counters.frames_in) +
                  " frames could not be read; the last: " + counters.last_error);
    }
    spdlog::info("stopped");
  });
}

}  // namespace weft::stage
