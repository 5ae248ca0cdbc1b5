#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "stage/log.hpp"
#include "stage/seq_set.hpp"
#include "tools/weft/message_types.hpp"

/// What can be done with a log. Every function reads it from front to back, in memory that does
/// not grow with its length, and never writes to it; an output appears when it is complete.
namespace weft {

/// Whether an event can be trusted. A log has no checksums: a flipped bit that leaves a message
/// decodable stays unseen.
class EventJudge {
 public:
  explicit EventJudge(const MessageTypes& types) : types_(types) {}
  /// Empty when nothing is wrong with the event, else what is.
  std::string fault(const stage::LogEvent& event);

 private:
  const MessageTypes& types_;
  std::map<std::string, std::string> type_of_channel_;
};

struct LogProblem {
  std::int64_t offset = 0;
  std::int64_t bytes = 0;
  std::string what;
};

/// What is in a log, and what is wrong with it.
struct LogSurvey {
  struct Channel {
    std::string type;  // of its first message; empty: unknown
    std::int64_t messages = 0, bytes = 0, largest = 0;
    std::int64_t frames = 0;   // different ones
    std::int64_t missing = 0;  // sequence numbers between the first and the last that are not there
    std::int64_t not_ok = 0;   // messages whose status is not OK
  };
  std::int64_t bytes = 0, events = 0;
  std::int64_t first_us = std::numeric_limits<std::int64_t>::max();
  std::int64_t last_us = std::numeric_limits<std::int64_t>::min();
  double seconds() const { return events > 0 ? static_cast<double>(last_us - first_us) * 1e-6 : 0; }
  std::map<std::string, Channel> channels;
  std::map<std::pair<std::string, std::int64_t>, std::pair<std::int64_t, std::int64_t>>
      sessions;  // (camera, session) to first and last seq

  std::vector<LogProblem> problems;  // the first kMaxDamages
  std::int64_t problem_count = 0;
  std::int64_t skipped_bytes = 0;   // that belong to no event
  std::int64_t faulty_events = 0;   // which EventJudge does not trust
  std::int64_t backward_steps = 0;  // events earlier than the one before; no fault by itself
  std::int64_t number_jumps = 0;    // events not numbered one after the other: lost, or filtered
  bool healthy() const { return problem_count == 0; }
};
LogSurvey survey_log(const std::string& file, const MessageTypes& types);

struct CopyCounts {
  std::int64_t read = 0, written = 0;
  std::int64_t left_out_faulty = 0;  // repair
  std::int64_t copies = 0;           // splice: events that were in another input, too
  std::vector<stage::LogReader::Damage> damage;
};

/// Copies the events that can be trusted.
CopyCounts repair_log(const std::string& file, const std::string& out, const MessageTypes& types);

struct LogFilter {
  std::vector<std::string> channels;  // regular expressions of whole names; empty: all
  std::vector<std::string> without;   // left out again
  std::string camera;                 // messages about frames of another camera are left out
  std::string robot = {};             // only channels with this prefix, which is taken off
  std::string as_robot = {};          // prefix that is put on
};
CopyCounts filter_log(const std::string& file, const std::string& out, const LogFilter& filter);

/// A piece of a log. Times count from its first event, or its first frame in a replay.
struct LogRange {
  std::optional<double> from_s, to_s;                // to_s itself is not in it
  std::optional<std::int64_t> from_frame, to_frame;  // seq; both are in it
  bool has_frames() const { return from_frame || to_frame; }
  bool has_times() const { return from_s || to_s; }
  bool holds_time(std::int64_t since_first_us) const;
  bool holds_frame(std::int64_t seq) const;
};
/// Throws Error when nothing is left. With frames, messages that belong to none (STAGE_STATUS) are
/// taken from the time in which the frames' messages lie.
CopyCounts cut_log(const std::string& file, const std::string& out, const LogRange& range);

/// One log from several in the order of time; within each the order stays. Events that two of them
/// recorded (same channel, same bytes; at most 2 s apart, 50 ms if they name no frame) are written
/// once.
CopyCounts splice_logs(const std::vector<std::string>& files, const std::string& out);

}  // namespace weft
