#pragma once

#include <string>
#include <vector>

#include "tools/weft/log_tools.hpp"
#include "tools/weft/session.hpp"

/// The subcommands of weft. Each returns the exit status: 0 only when all was well.
namespace weft {

struct UpOptions {
  std::string set;
  std::string host;  // empty: this one
  double ready_s = 60;
};
int up(const UpOptions& options);
int down(const std::string& set);
struct StatusOptions {
  std::string set;
  std::string json;
  double listen_s = 2.2;
};
int status(const StatusOptions& options, const StageRegistry& registry);
struct LogsOptions {
  std::string process;
  std::string set;
  int lines = 30;
  bool follow = false;
};
int logs(const LogsOptions& options);
int restart(const std::string& process, const std::string& set);

struct RecordOptions {
  std::string out;
  std::string set;  // file, or name of a running set; empty: default URL
  std::string url, json;
  std::string channels = ".*";  // regular expression
  double duration_s = 0;        // 0: until stopped
};
int record_command(const RecordOptions& options);

struct TriggerOptions {
  std::string set;     // file, or name of a running set
  std::string camera;  // empty: every camera of the set that waits for triggers
  double timeout_s = 5;
};
int trigger_command(const TriggerOptions& options);

/// Where a set talks: of a URL, a set file or a running set; all empty: the default URL.
stage::LcmUrl url_to_hear(const std::string& url, const std::string& set);

struct DoctorOptions {
  std::string set;           // file; empty: the machine alone
  std::string folder = ".";  // where logs are recorded
  std::string json;
  double listen_s = 2.5;
};
int doctor_command(const DoctorOptions& options, const StageRegistry& registry);

struct SpyOptions {
  std::string set;  // file, or name of a running set; empty: default URL
  std::string url, types, json;
  std::string channels = ".*";  // regular expression
  std::vector<std::string> show;
  double duration_s = 0;  // 0: until stopped on a terminal, else 5
};
int spy_command(const SpyOptions& options);

struct ReplayCommand {
  std::string log, set, out, json, from;
  bool verify = false;
  std::string reference;
  bool in_process = false, attach = false;
  int window = 4;
  double timeout_s = 60;
  std::vector<std::string> swaps;  // STAGE=EXE
  LogRange range;
  double speed = 0;  // of the recorded time; 0: as fast as the stages answer
  bool step = false;
  std::vector<std::string> show;  // channels to decode, frame by frame
  std::string types;
};
int replay_command(const ReplayCommand& command, const StageRegistry& registry);

struct DemoCommand {
  std::string log, set, json, truth;
  std::string out = "out/demo";
  long frames = 0;
  double threshold = 0.2;
  int window = 4;
  bool in_process = false;
};
int demo_command(const DemoCommand& command, const StageRegistry& registry);

struct CompareCommand {
  std::string log_a, log_b, variant, json, html, types, truth, channel = "PART_DETECTIONS";
  double threshold = 0.2;
  double overlap = 0.5;
  int pictures = 24;
};
int compare_command(const CompareCommand& command);

int timing_command(const std::string& log, const std::string& json, const std::string& html,
                   const std::string& trace);
/// types: folder of .lcm files besides the built-in ones; empty: none.
int log_info_command(const std::string& log, const std::string& json, const std::string& types);
int log_check_command(const std::string& log, const std::string& json, const std::string& types);
int log_repair_command(const std::string& log, const std::string& out, const std::string& types);
int log_filter_command(const std::string& log, const std::string& out, const LogFilter& filter);
int log_cut_command(const std::string& log, const std::string& out, const LogRange& range);
int log_splice_command(const std::vector<std::string>& logs, const std::string& out);
int log_hash_command(const std::string& log);

/// Stages this program was built with.
const StageRegistry& built_in_stages();

}  // namespace weft
