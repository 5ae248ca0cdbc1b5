#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>

#include "base/error.hpp"
#include "base/project.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/commands.hpp"

namespace weft {
namespace {

/// Subcommands that are programs of their own, beside this one.
const std::map<std::string, std::string> kPrograms = {
    {"capture", "turn scans or a camera into RGBD_FRAME messages or a log"},
    {"train", "models from a dataset"},
    {"evaluate", "the tables of the papers from models and logs"},
    {"export", "the map of a log as PLY, PCD, OBJ, JSON and pictures"},
    {"synth", "make synthetic scenes"},
    {"bench", "benchmarks, each with its peer in the same run"},
};

std::string benches() {
  std::string names;
  for (const auto& entry : std::filesystem::directory_iterator(program_folder())) {
    const auto file = entry.path().filename().string();
    if (file.starts_with("weft-bench-")) names += " " + file.substr(11);
  }
  return names.empty() ? " none; build the dev preset" : names;
}

/// weft bench NAME is the program weft-bench-NAME, weft train the program weft-train.
int run_program(const std::string& name, std::vector<std::string> args) {
  std::string program = "weft-" + name;
  const bool bench = name == "bench";
  if (bench) {
    if (args.empty() || args.front().starts_with("-")) {
      fmt::print("usage: weft bench NAME [options]; built here:{}\n", benches());
      return args.empty() || args.front() != "--help" ? 2 : 0;
    }
    if (args.front().find('/') != std::string::npos)
      throw Error("there is no benchmark '" + args.front() + "'; built here:" + benches());
    program += "-" + args.front();
    args.erase(args.begin());
  }
  const auto path = program_folder() / program;
  if (access(path.c_str(), X_OK) != 0) {
    throw Error(bench
                    ? "there is no benchmark '" + program.substr(11) + "'; built here:" + benches()
                    : path.string() + " is not built; build the target " + program +
                          (name == "synth" ? " (it needs Embree 3; Debian: libembree-dev)" : ""));
  }
  std::string path_text = path.string();
  std::vector<char*> argv{path_text.data()};
  for (auto& arg : args) argv.push_back(arg.data());
  argv.push_back(nullptr);
  execv(argv[0], argv.data());
  throw Error("cannot run " + path_text);
}

int run(int argc, char** argv) {
  if (argc > 1 && kPrograms.contains(argv[1]))
    return run_program(argv[1], std::vector<std::string>(argv + 2, argv + argc));

  CLI::App app("Weft: perception for robots that handle clothes", "weft");
  app.set_version_flag("--version", stage::build_text());
  app.require_subcommand(1);
  std::function<int()> chosen;

  DemoCommand demo;
  auto* sub = app.add_subcommand("demo", "the main job on the sample log: parts and grasp points");
  sub->add_option("--set", demo.set, "process set; default config/sets/parts-sift.yaml");
  sub->add_option("--log", demo.log, "log to play; default logs/sample.lcm");
  sub->add_option("--loop", demo.frames, "frames to play, repeating the log as new frames")
      ->check(CLI::Range(1, 10000000));
  sub->add_option("--json", demo.json, "write the figures to this file");
  sub->add_option(
      "--truth", demo.truth,
      "dataset folder the log was captured from: the page shows its part polygons, too");
  sub->add_option("--out", demo.out, "folder for the page")->capture_default_str();
  sub->add_option("--threshold", demo.threshold,
                  "probability of being right a detection must have to be counted")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  sub->add_option("--window", demo.window, "frames in flight")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  sub->add_flag("--in-process", demo.in_process, "all stages in one process");
  sub->callback([&] { chosen = [&] { return demo_command(demo, built_in_stages()); }; });

  UpOptions up_options;
  sub = app.add_subcommand("up", "start a process set on this host and keep it running");
  sub->add_option("set", up_options.set, "process set, e.g. config/sets/parts-sift.yaml")
      ->required();
  sub->add_option("--host", up_options.host, "run the processes of this host; default: its name");
  sub->add_option("--ready-s", up_options.ready_s, "how long the processes may take to be ready")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str();
  sub->callback([&] { chosen = [&] { return up(up_options); }; });

  std::string set_name;
  sub = app.add_subcommand("down", "stop a running set");
  sub->add_option("set", set_name, "its name or file; not needed when only one is running");
  sub->callback([&] { chosen = [&] { return down(set_name); }; });

  StatusOptions status_options;
  sub = app.add_subcommand("status", "how the processes of a running set are doing");
  sub->add_option("set", status_options.set, "its name or file");
  sub->add_option("--json", status_options.json, "write it to this file");
  sub->add_option("--listen-s", status_options.listen_s, "how long to listen to STAGE_STATUS")
      ->check(CLI::Range(0.1, 60.0))
      ->capture_default_str();
  sub->callback([&] { chosen = [&] { return status(status_options, built_in_stages()); }; });

  LogsOptions logs_options;
  sub = app.add_subcommand("logs", "what a process of a running set wrote");
  sub->add_option("process", logs_options.process)->required();
  sub->add_option("--set", logs_options.set, "name or file of the set");
  sub->add_option("-n,--lines", logs_options.lines, "how many lines")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  sub->add_flag("-f,--follow", logs_options.follow, "go on as it writes more");
  sub->callback([&] { chosen = [&] { return logs(logs_options); }; });

  std::string process;
  sub = app.add_subcommand("restart", "stop and start one process of a running set");
  sub->add_option("process", process)->required();
  sub->add_option("--set", set_name, "name or file of the set");
  sub->callback([&] { chosen = [&] { return restart(process, set_name); }; });

  DoctorOptions doctor;
  sub = app.add_subcommand("doctor", "what would stop this machine or a set, and the remedies");
  sub->add_option("set", doctor.set, "process set to check as well");
  sub->add_option("--folder", doctor.folder, "where logs are recorded")->capture_default_str();
  sub->add_option("--listen-s", doctor.listen_s, "how long to listen to the stages that run")
      ->check(CLI::Range(0.0, 60.0))
      ->capture_default_str();
  sub->add_option("--json", doctor.json, "write it to this file");
  sub->callback([&] { chosen = [&] { return doctor_command(doctor, built_in_stages()); }; });

  SpyOptions spy;
  sub = app.add_subcommand("spy", "what is on the air: channels, rates, bandwidth, gaps, fields");
  sub->add_option("set", spy.set, "set file or name of a running set; default: the default URL");
  sub->add_option("--url", spy.url, "LCM URL");
  sub->add_option("--channel", spy.channels, "regular expression of the channels to hear")
      ->capture_default_str();
  sub->add_option("--show", spy.show, "show the newest message of this channel, decoded");
  sub->add_option("--duration", spy.duration_s,
                  "seconds to listen; default: until q on a terminal, else 5")
      ->check(CLI::Range(0.1, 1e6));
  sub->add_option("--json", spy.json, "write it to this file");
  sub->add_option("--types", spy.types, "folder of .lcm files of your own message types");
  sub->callback([&] { chosen = [&] { return spy_command(spy); }; });

  RecordOptions record;
  sub = app.add_subcommand("record", "write what is on the air to a log");
  sub->add_option("out", record.out, "log to write; must not exist")->required();
  sub->add_option("--set", record.set,
                  "set file or name of a running set; default: the default URL");
  sub->add_option("--url", record.url, "LCM URL");
  sub->add_option("--channel", record.channels, "regular expression of the channels to record")
      ->capture_default_str();
  sub->add_option("--duration", record.duration_s, "seconds to record; default: until stopped")
      ->check(CLI::Range(0.1, 1e9));
  sub->add_option("--json", record.json, "write the counts to this file");
  sub->callback([&] { chosen = [&] { return record_command(record); }; });

  TriggerOptions trigger;
  sub = app.add_subcommand("trigger", "one frame of each camera that waits for a trigger");
  sub->add_option("set", trigger.set, "its name or file; not needed when only one is running");
  sub->add_option("--camera", trigger.camera, "of this camera alone");
  sub->add_option("--timeout-s", trigger.timeout_s, "how long to wait for the frame")
      ->check(CLI::Range(0.1, 600.0))
      ->capture_default_str();
  sub->callback([&] { chosen = [&] { return trigger_command(trigger); }; });

  ReplayCommand replay;
  sub =
      app.add_subcommand("replay", "play the source channels of a log through a set, in lock-step");
  sub->add_option("log", replay.log)->required();
  sub->add_option("--set", replay.set, "process set")->required();
  sub->add_option("--out", replay.out, "log to write")->required();
  auto* verify = sub->add_option("--verify", replay.reference,
                                 "compare with this log; without one, with a second replay")
                     ->expected(0, 1);
  sub->add_option("--json", replay.json, "write the figures to this file");
  sub->add_option("--swap", replay.swaps, "another program for one stage; may be repeated")
      ->type_name("STAGE=PROGRAM");
  sub->add_option("--from", replay.from,
                  "run this stage and those after it in the set; what they read comes from the log")
      ->type_name("STAGE");
  sub->add_option("--window", replay.window, "frames in flight")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  sub->add_option("--timeout-s", replay.timeout_s, "then a frame counts as unanswered")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  auto* in_process = sub->add_flag("--in-process", replay.in_process, "all stages in one process");
  sub->add_flag("--attach", replay.attach, "use the processes that run already, in lock-step")
      ->excludes(in_process);
  sub->add_option("--from-s", replay.range.from_s, "first second, from the log's first frame");
  sub->add_option("--to-s", replay.range.to_s, "where to end, s from the log's first frame");
  sub->add_option("--from-frame", replay.range.from_frame, "first frame (seq)");
  sub->add_option("--to-frame", replay.range.to_frame, "last frame (seq)");
  sub->add_option("--speed", replay.speed,
                  "times the recorded speed; default: as fast as the stages answer")
      ->check(CLI::Range(0.001, 1000.0));
  sub->add_flag("--step", replay.step, "wait for Enter before every frame; space: go on");
  sub->add_option("--show", replay.show, "show the messages of this channel, decoded");
  sub->add_option("--types", replay.types, "folder of .lcm files of your own message types");
  sub->callback([&] {
    replay.verify = verify->count() > 0;
    chosen = [&] { return replay_command(replay, built_in_stages()); };
  });

  CompareCommand compare;
  sub = app.add_subcommand("compare", "what differs between two runs, or a run and its variant");
  sub->add_option("log_a", compare.log_a)->required();
  auto* log_b = sub->add_option("log_b", compare.log_b);
  sub->add_option("--variant", compare.variant,
                  "compare CHANNEL with CHANNEL@VARIANT of one log, instead of two logs")
      ->excludes(log_b);
  sub->add_option("--truth", compare.truth,
                  "dataset folder the frames were captured from: recall and precision of both, and "
                  "their difference");
  sub->add_option("--channel", compare.channel, "detections that are judged by the truth")
      ->capture_default_str();
  sub->add_option("--json", compare.json, "write it to this file");
  sub->add_option("--html", compare.html, "write a page with pictures to this file");
  sub->add_option("--threshold", compare.threshold, "detections below this do not count")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  sub->add_option("--overlap", compare.overlap,
                  "intersection over union from which two detections are the same")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  sub->add_option("--pictures", compare.pictures, "frames on the page, the most different first")
      ->check(CLI::Range(0, 1000))
      ->capture_default_str();
  sub->add_option("--types", compare.types, "folder of .lcm files of your own message types");
  sub->callback([&] {
    if (compare.log_b.empty() && compare.variant.empty())
      throw CLI::ValidationError("give a second log, or --variant");
    chosen = [&] { return compare_command(compare); };
  });

  std::string log, json, html, trace;
  sub = app.add_subcommand("timing", "where the time went, from a log's STAGE_TIMING");
  sub->add_option("log", log)->required();
  sub->add_option("--json", json, "write the table to this file");
  sub->add_option("--html", html, "write a page with the timeline to this file");
  sub->add_option("--trace", trace, "write a trace for chrome://tracing to this file");
  sub->callback([&] { chosen = [&] { return timing_command(log, json, html, trace); }; });

  std::string types, out;
  std::vector<std::string> inputs;
  LogFilter filter;
  LogRange range;
  auto* log_command = app.add_subcommand("log", "look into logs, mend and cut them");
  log_command->require_subcommand(1);
  const auto add_log_command = [&](const char* name, const char* summary) {
    auto* command = log_command->add_subcommand(name, summary);
    command->add_option("log", log)->required();
    return command;
  };
  const auto add_types = [&](CLI::App* command) {
    command->add_option("--types", types, "folder of .lcm files of your own message types");
  };
  const auto add_out = [&](CLI::App* command) {
    command->add_option("--out", out, "log to write")->required();
  };
  const auto add_range = [](CLI::App* command, LogRange& of) {
    command->add_option("--from-s", of.from_s, "first second, from the log's beginning");
    command->add_option("--to-s", of.to_s, "where to end, s from the log's beginning");
    command->add_option("--from-frame", of.from_frame, "first frame (seq)");
    command->add_option("--to-frame", of.to_frame, "last frame (seq)");
  };
  sub = add_log_command("info", "channels, types, frames, sizes");
  sub->add_option("--json", json, "write it to this file");
  add_types(sub);
  sub->callback([&] { chosen = [&] { return log_info_command(log, json, types); }; });
  sub = add_log_command("check", "every damage, fault and gap; status 1 when something is damaged");
  sub->add_option("--json", json, "write it to this file");
  add_types(sub);
  sub->callback([&] { chosen = [&] { return log_check_command(log, json, types); }; });
  sub = add_log_command("repair", "copy every event that can be trusted");
  add_out(sub);
  add_types(sub);
  sub->callback([&] { chosen = [&] { return log_repair_command(log, out, types); }; });
  sub = add_log_command("filter", "copy some channels, or one camera");
  add_out(sub);
  sub->add_option("--channel", filter.channels,
                  "regular expression of a whole channel name; may be repeated; default: all");
  sub->add_option("--without", filter.without, "channels to leave out; may be repeated");
  sub->add_option("--camera", filter.camera, "leave out messages about other cameras' frames");
  sub->add_option("--robot", filter.robot,
                  "of a log that lcm-logger wrote: channels with this prefix alone, without it");
  sub->add_option("--as-robot", filter.as_robot,
                  "write the channels with this prefix: for lcm-logplayer and a set that has it");
  sub->callback([&] { chosen = [&] { return log_filter_command(log, out, filter); }; });
  sub = add_log_command("cut", "copy a piece, by time or by frames");
  add_out(sub);
  add_range(sub, range);
  sub->callback([&] { chosen = [&] { return log_cut_command(log, out, range); }; });
  sub = log_command->add_subcommand(
      "splice", "one log from several, in order of time, what two of them hold only once");
  sub->add_option("logs", inputs)->required();
  add_out(sub);
  sub->callback([&] { chosen = [&] { return log_splice_command(inputs, out); }; });
  sub = add_log_command(
      "hash",
      "a line for each payload (seq, channel, hash): what two equal replays have in common");
  sub->callback([&] { chosen = [&] { return log_hash_command(log); }; });

  std::string programs;
  for (const auto& [name, summary] : kPrograms)
    programs += fmt::format("  {:<27} {}\n", name, summary);
  app.footer("Programs of their own:\n" + programs + "\nweft COMMAND --help says more.");

  // CLI11 would only say that a subcommand is missing.
  const auto known = app.get_subcommands([](CLI::App* each) { return !each->get_name().empty(); });
  if (argc > 1 && argv[1][0] != '-' &&
      std::none_of(known.begin(), known.end(),
                   [&](const CLI::App* each) { return each->get_name() == argv[1]; })) {
    fmt::print(stderr, "weft: there is no command '{}'; weft --help lists them\n", argv[1]);
    return 2;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  return chosen();
}

}  // namespace
}  // namespace weft

int main(int argc, char** argv) {
  try {
    return weft::run(argc, argv);
  } catch (const weft::Interrupted&) {
    fmt::print(stderr, "\nstopped\n");
    return 130;
  } catch (const std::exception& e) {
    fmt::print(stderr, "weft: {}\n", e.what());
    return 1;
  }
}
