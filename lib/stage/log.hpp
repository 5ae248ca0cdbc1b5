#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

/// Reading and writing LCM logs. LCM's own reader stops at a bad sync word as if the file ended
/// there, and allocates what a damaged length says; this one goes on and reports.
namespace weft::stage {

struct LogEvent {
  std::int64_t number = 0;  // as in the file
  std::int64_t timestamp_us = 0;
  std::string channel;
  std::vector<std::uint8_t> data;
  /// Another event or the end of the file comes right after this one. If not, either what follows
  /// is damaged, or the length of this event is.
  bool followed = true;
};

class LogReader {
 public:
  struct Damage {
    std::int64_t offset = 0;  // where it begins in the file
    std::int64_t bytes = 0;   // how much was skipped
    std::string what;
  };

  /// Throws Error when the file cannot be read or is no LCM log. An empty file is a log without
  /// events.
  explicit LogReader(const std::string& path);
  /// The next whole event; false at the end of the file. Skips what is damaged and notes it.
  bool next(LogEvent& event);
  /// For a caller that cannot believe the event next() gave last: whether its bytes hold an event
  /// that leads to another. If so, that is the next one, and what is before it is damage: a length
  /// that grew may end right at a later event.
  bool look_inside();
  void rewind();
  /// Back to where offset() was before an event.
  void seek(std::int64_t offset) { offset_ = offset; }
  /// What was skipped, of more than kMaxDamages the first.
  const std::vector<Damage>& damage() const { return damage_; }
  static constexpr std::size_t kMaxDamages = 1000;
  std::int64_t damage_count() const { return damage_count_; }
  std::int64_t damaged_bytes() const { return damaged_bytes_; }
  std::int64_t offset() const { return offset_; }  // of the next event; with size(): progress
  std::int64_t size() const { return size_; }

 private:
  struct Header {
    std::int64_t number = 0;
    std::int64_t timestamp_us = 0;
    std::int64_t data_bytes = 0;
    std::string channel;
    std::int64_t end = 0;  // offset of the event after this one; may lie beyond the file's end
  };
  bool read_header(std::int64_t offset, Header& header);
  /// The first event that begins in [from, until); followed: only those that lead to another.
  bool find_event(std::int64_t from, std::int64_t until, bool followed, std::int64_t& found);
  bool cut_off(std::int64_t offset);  // begins an event in the last bytes of the file
  bool leads_on(std::int64_t end);
  void read_data(const Header& header, LogEvent& event);
  void skip_to(std::int64_t offset, std::string what);
  bool read_at(std::int64_t offset, void* to, std::size_t size);

  std::string path_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::int64_t offset_ = 0;
  std::int64_t last_at_ = 0;  // of the event next() gave last
  std::int64_t size_ = 0;
  Header newest_;  // header that was read last, and where
  std::int64_t newest_at_ = -1;
  std::vector<Damage> damage_;
  std::int64_t damage_count_ = 0;
  std::int64_t damaged_bytes_ = 0;
};

/// Writes the same bytes for the same events: timestamps are the caller's and events are numbered
/// from 0.
class LogWriter {
 public:
  /// Replaces the file. Throws Error when it cannot be written.
  explicit LogWriter(const std::string& path);
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;
  /// Throws Error on a full disk, or a channel name without 1 to 63 characters. On a full disk the
  /// file is cut to the events that are whole in it, and closed.
  void write(std::int64_t timestamp_us, const std::string& channel, const void* data,
             std::size_t size);
  void write(std::int64_t timestamp_us, const std::string& channel,
             const std::vector<std::uint8_t>& data) {
    write(timestamp_us, channel, data.data(), data.size());
  }
  /// Hands everything to the system, so that it can be read and a full disk is noticed now. Throws
  /// as write() does.
  void flush();
  /// Throws Error when the last bytes cannot be written; the destructor would say nothing.
  void close();
  std::int64_t bytes() const { return end_; }

 private:
  std::string path_;
  [[noreturn]] void fail();
  std::FILE* file_ = nullptr;
  std::int64_t number_ = 0;
  std::int64_t end_ = 0;            // of the last event
  std::vector<std::int64_t> ends_;  // of the events that may not be in the file yet
};

}  // namespace weft::stage
