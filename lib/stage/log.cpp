#include "stage/log.hpp"

#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "base/error.hpp"

namespace weft::stage {
namespace {

// An event: sync word, number (8), timestamp (8), channel length (4), data length (4), channel,
// data; all big-endian.
constexpr std::uint32_t kSync = 0xEDA1DA01u;
constexpr std::array<std::uint8_t, 4> kSyncBytes{0xED, 0xA1, 0xDA, 0x01};
constexpr std::int64_t kHeaderBytes = 28;
constexpr std::size_t kMaxChannel = 63;
/// An event of more is only read when its length is sound: a flipped bit in a length must not cost
/// the memory or the events it seems to span.
constexpr std::int64_t kSmallEvent = 1 << 20;

constexpr const char* kOverrun = "an event whose length runs over those after it";

std::uint64_t big_endian(const std::uint8_t* from, int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8 | from[i];
  return value;
}

void put(std::vector<std::uint8_t>& to, std::uint64_t value, int bytes) {
  for (int i = bytes - 1; i >= 0; --i) to.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

std::string reason() { return std::strerror(errno); }

}  // namespace

LogReader::LogReader(const std::string& path)
    : path_(path), file_(std::fopen(path.c_str(), "rb"), &std::fclose) {
  struct stat info {};
  if (!file_ || fstat(fileno(file_.get()), &info) != 0)
    throw Error(path + ": cannot open the log: " + reason());
  if (!S_ISREG(info.st_mode)) throw Error(path + ": is not a file");
  size_ = info.st_size;
  std::int64_t first = 0;
  if (size_ > 0 && !find_event(0, size_, false, first))
    throw Error(path + ": holds no LCM event; is it a log?");
}

void LogReader::rewind() {
  offset_ = 0;
  damage_.clear();
  damage_count_ = damaged_bytes_ = 0;
}

bool LogReader::read_at(std::int64_t offset, void* to, std::size_t size) {
  if (size == 0) return true;  // `to` may be null then
  // Seeking throws the buffer away, so not when reading on.
  if (ftello(file_.get()) != offset && fseeko(file_.get(), offset, SEEK_SET) != 0) return false;
  return std::fread(to, 1, size, file_.get()) == size;
}

bool LogReader::read_header(std::int64_t offset, Header& header) {
  if (offset == newest_at_) {
    header = newest_;
    return true;
  }
  std::array<std::uint8_t, kHeaderBytes> raw{};
  if (offset + kHeaderBytes > size_ || !read_at(offset, raw.data(), raw.size())) return false;
  const auto channel_bytes = big_endian(&raw[20], 4);
  if (big_endian(&raw[0], 4) != kSync || channel_bytes < 1 || channel_bytes > kMaxChannel ||
      raw[24] >= 0x80)
    return false;
  header.number = static_cast<std::int64_t>(big_endian(&raw[4], 8));
  header.timestamp_us = static_cast<std::int64_t>(big_endian(&raw[12], 8));
  header.data_bytes = static_cast<std::int64_t>(big_endian(&raw[24], 4));
  header.end = offset + kHeaderBytes + static_cast<std::int64_t>(channel_bytes) + header.data_bytes;
  header.channel.resize(channel_bytes);
  if (!read_at(offset + kHeaderBytes, header.channel.data(), channel_bytes)) return false;
  for (const char c : header.channel)
    if (c < ' ' || c > '~') return false;
  newest_ = header;
  newest_at_ = offset;
  return true;
}

bool LogReader::cut_off(std::int64_t offset) {
  const auto left = size_ - offset;
  std::array<std::uint8_t, 4> raw{};
  const auto count = static_cast<std::size_t>(std::min<std::int64_t>(left, 4));
  return left < kHeaderBytes + static_cast<std::int64_t>(kMaxChannel) &&
         read_at(offset, raw.data(), count) &&
         std::equal(raw.begin(), raw.begin() + static_cast<std::ptrdiff_t>(count),
                    kSyncBytes.begin());
}

bool LogReader::leads_on(std::int64_t end) {
  Header header;
  return end == size_ || read_header(end, header) || cut_off(end);
}

bool LogReader::find_event(std::int64_t from, std::int64_t until, bool followed,
                           std::int64_t& found) {
  std::array<std::uint8_t, 1 << 16> chunk{};
  const auto end = std::min(size_, until + 3);  // a sync word may begin right before
  for (std::int64_t offset = from; offset + 4 <= end;) {
    const auto count = static_cast<std::size_t>(std::min<std::int64_t>(chunk.size(), end - offset));
    if (!read_at(offset, chunk.data(), count)) return false;
    for (std::size_t at = 0;; ++at) {
      const void* hit = memmem(&chunk[at], count - at, kSyncBytes.data(), kSyncBytes.size());
      if (!hit) break;
      at = static_cast<std::size_t>(static_cast<const std::uint8_t*>(hit) - chunk.data());
      const auto begin = offset + static_cast<std::int64_t>(at);
      Header header;
      if (read_header(begin, header) && header.end <= size_ &&
          (!followed || leads_on(header.end))) {
        found = begin;
        return true;
      }
    }
    offset += static_cast<std::int64_t>(count) - 3;  // a sync word may lie across
  }
  return false;
}

void LogReader::skip_to(std::int64_t offset, std::string what) {
  ++damage_count_;
  damaged_bytes_ += offset - offset_;
  if (damage_.size() < kMaxDamages) damage_.push_back({offset_, offset - offset_, std::move(what)});
  offset_ = offset;
}

bool LogReader::next(LogEvent& event) {
  while (offset_ < size_) {
    Header header;
    const bool sound = read_header(offset_, header);
    if (sound && header.end <= size_) {
      // Small events are read first, so that a healthy log is read from front to back.
      const bool small = header.data_bytes <= kSmallEvent;
      if (small) read_data(header, event);
      event.followed = leads_on(header.end);
      std::int64_t inner = 0;
      if (!event.followed && find_event(offset_ + 1, header.end, true, inner)) {
        skip_to(inner, kOverrun);
        continue;
      }
      if (!small) read_data(header, event);
      event.number = header.number;
      event.timestamp_us = header.timestamp_us;
      event.channel = std::move(header.channel);
      last_at_ = offset_;
      offset_ = header.end;
      return true;
    }
    std::int64_t resume = size_;
    const bool resumed = find_event(offset_ + 1, size_, false, resume);
    skip_to(resume, resumed
                        ? (sound ? "an event longer than the rest of the file"
                                 : "bad sync word or event header")
                        : (sound || cut_off(offset_) ? "the last event is cut off"
                                                     : "the end of the file holds no whole event"));
  }
  return false;
}

bool LogReader::look_inside() {
  std::int64_t inner = 0;
  if (!find_event(last_at_ + 1, offset_, true, inner)) return false;
  offset_ = last_at_;
  skip_to(inner, kOverrun);
  return true;
}

void LogReader::read_data(const Header& header, LogEvent& event) {
  event.data.resize(static_cast<std::size_t>(header.data_bytes));
  if (!read_at(header.end - header.data_bytes, event.data.data(), event.data.size()))
    throw Error(path_ + ": cannot read at byte " + std::to_string(offset_) + ": " + reason());
}

LogWriter::LogWriter(const std::string& path) : path_(path), file_(std::fopen(path.c_str(), "wb")) {
  if (!file_) throw Error(path + ": cannot write the log: " + reason());
}

LogWriter::~LogWriter() {
  if (file_) std::fclose(file_);
}

void LogWriter::write(std::int64_t timestamp_us, const std::string& channel, const void* data,
                      std::size_t size) {
  if (!file_) throw Error(path_ + ": the log is closed");
  if (channel.empty() || channel.size() > kMaxChannel)
    throw Error(path_ + ": the channel name '" + channel + "' must have 1 to 63 characters");
  if (size > 0x7fffffffu) throw Error(path_ + ": an event of more than 2 GB");
  std::vector<std::uint8_t> head;
  put(head, kSync, 4);
  put(head, static_cast<std::uint64_t>(number_++), 8);
  put(head, static_cast<std::uint64_t>(timestamp_us), 8);
  put(head, channel.size(), 4);
  put(head, size, 4);
  head.insert(head.end(), channel.begin(), channel.end());
  if (std::fwrite(head.data(), 1, head.size(), file_) != head.size() ||
      (size > 0 && std::fwrite(data, 1, size, file_) != size))  // data may be null without size
    fail();
  end_ += static_cast<std::int64_t>(head.size() + size);
  ends_.push_back(end_);
  constexpr std::size_t kMostUnflushed = 10'000;
  if (ends_.size() > kMostUnflushed) flush();
}

void LogWriter::flush() {
  if (!file_) throw Error(path_ + ": the log is closed");
  if (std::fflush(file_) != 0) fail();
  ends_.assign(1, end_);
}

void LogWriter::fail() {
  const std::string why = reason();
  std::FILE* file = std::exchange(file_, nullptr);
  // What is in the C library's buffer will never be in the file.
  struct stat info {};
  const bool known = fstat(fileno(file), &info) == 0;
  const auto after = std::upper_bound(ends_.begin(), ends_.end(), std::int64_t{info.st_size});
  const std::int64_t whole = after == ends_.begin() ? 0 : *std::prev(after);
  const int fd = dup(fileno(file));
  std::fclose(file);
  if (known && S_ISREG(info.st_mode) && (fd < 0 || ftruncate(fd, whole) != 0))
    spdlog::warn("{}: the half event at its end stays", path_);
  if (fd >= 0) ::close(fd);
  throw Error(path_ + ": cannot write: " + why + "; it holds the first " + std::to_string(whole) +
              " bytes, whole events");
}

void LogWriter::close() {
  if (!file_) return;
  flush();
  std::FILE* file = std::exchange(file_, nullptr);
  if (std::fclose(file) != 0) throw Error(path_ + ": cannot write: " + reason());
}

}  // namespace weft::stage
