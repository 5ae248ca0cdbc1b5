#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "stage/log.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/log_tools.hpp"

namespace weft {

/// What the source channels of a log say about one frame.
struct SourceFrame {
  FrameName name;
  std::int64_t utime = 0;
  std::vector<stage::LogEvent> events;  // in the log's order, exact repeats left out
  std::size_t pass = 0;                 // how often the log had been played before
};

/// The frames of a log's source channels, in the order in which they first appear.
class SourceLog {
 public:
  /// Reads the log once. Throws Error when it holds no frame on these channels.
  SourceLog(const std::string& file, const std::vector<std::string>& channels);

  /// Leaves out the frames that are not in this range; times count from the first frame of all.
  /// Throws Error when none is left.
  void select(const LogRange& range);
  std::int64_t utime(std::size_t index) const;
  /// What of the log could not be read.
  const std::vector<stage::LogReader::Damage>& damage() const { return damage_; }
  /// Frames in one pass over the log.
  std::size_t size() const { return entries_.size(); }
  /// Frame index of an endless repetition of the log. From the second pass on the frames have new
  /// sequence numbers and times, which go on where the pass before ended.
  SourceFrame read(std::size_t index);

 private:
  void note_session(const FrameName& frame, std::int64_t utime);
  struct Entry {
    FrameName name;
    std::int64_t utime = 0;
    std::vector<std::int64_t> positions;
  };
  struct Session {  // what one pass advances, by camera and session
    std::string camera;
    std::int64_t session = 0;
    std::int64_t seq_first = 0;
    std::int64_t seq_last = 0;
    std::int64_t utime_first = 0;
    std::int64_t utime_last = 0;
    std::int64_t count = 0;
  };
  const Session& session_of(const FrameName& frame) const;
  std::int64_t pass_us(const FrameName& frame) const;  // by how much one pass advances the time
  std::string file_;
  stage::LogReader reader_;
  std::vector<stage::LogReader::Damage> damage_;
  std::vector<Entry> entries_;
  std::vector<Session> sessions_;
};

}  // namespace weft
