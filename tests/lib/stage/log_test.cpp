#include "stage/log.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <lcm/lcm-cpp.hpp>
#include <random>

#include "base/error.hpp"

namespace weft::stage {
namespace {

using Bytes = std::vector<std::uint8_t>;

class Log : public testing::Test {
 protected:
  Log() { std::filesystem::create_directories(folder_); }
  ~Log() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  static std::string text(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void write_text(const std::string& file, const std::string& content) const {
    std::ofstream(file, std::ios::binary) << content;
  }
  static Bytes data(int i) {
    return Bytes(static_cast<std::size_t>(20 + i), static_cast<std::uint8_t>(i));
  }
  void write(const std::string& file, int events) const {
    LogWriter writer(file);
    for (int i = 0; i < events; ++i)
      writer.write(1000 + i, i % 2 ? "RGBD_FRAME" : "WORDS_SIFT@b", data(i));
    writer.close();
  }
  /// The numbers of the events that can be read.
  static std::vector<std::int64_t> numbers(LogReader& reader) {
    std::vector<std::int64_t> out;
    LogEvent event;
    while (reader.next(event)) {
      EXPECT_EQ(event.timestamp_us, 1000 + event.number);
      EXPECT_EQ(event.data, data(static_cast<int>(event.number)));
      out.push_back(event.number);
    }
    return out;
  }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() / ("weft-log-test-" + std::to_string(::getpid()));
};

// Offsets of event i: 28 bytes of header, a channel of 10 or 12 characters, 20 + i bytes of data.
std::size_t offset_of(int i) {
  std::size_t offset = 0;
  for (int k = 0; k < i; ++k) offset += 28 + (k % 2 ? 10 : 12) + 20 + static_cast<std::size_t>(k);
  return offset;
}

TEST_F(Log, LcmReadsWhatIsWritten) {
  write(path("a.lcm"), 10);
  lcm::LogFile file(path("a.lcm"), "r");
  for (int i = 0; i < 10; ++i) {
    const auto* event = file.readNextEvent();
    ASSERT_TRUE(event);
    EXPECT_EQ(event->eventnum, i);
    EXPECT_EQ(event->timestamp, 1000 + i);
    EXPECT_EQ(event->channel, i % 2 ? "RGBD_FRAME" : "WORDS_SIFT@b");
    const auto* bytes = static_cast<const std::uint8_t*>(event->data);
    EXPECT_EQ(Bytes(bytes, bytes + event->datalen), data(i));
  }
  EXPECT_FALSE(file.readNextEvent());
}

TEST_F(Log, ReadsWhatLcmWrites) {
  {
    lcm::LogFile file(path("a.lcm"), "w");
    for (int i = 0; i < 10; ++i) {
      Bytes bytes = data(i);
      lcm::LogEvent event{0, 1000 + i, "CHANNEL", static_cast<std::int32_t>(bytes.size()),
                          bytes.data()};
      file.writeEvent(&event);
    }
  }
  LogReader reader(path("a.lcm"));
  EXPECT_EQ(numbers(reader).size(), 10u);
  EXPECT_TRUE(reader.damage().empty());
  EXPECT_EQ(reader.offset(), reader.size());
  reader.rewind();
  EXPECT_EQ(numbers(reader).size(), 10u);
}

TEST_F(Log, SameEventsSameBytes) {
  write(path("a.lcm"), 50);
  write(path("b.lcm"), 50);
  EXPECT_EQ(text(path("a.lcm")), text(path("b.lcm")));
}

TEST_F(Log, ReportsACutOffTail) {
  write(path("a.lcm"), 5);
  const std::string whole = text(path("a.lcm"));
  for (std::size_t length = offset_of(4) + 1; length < whole.size(); ++length) {
    write_text(path("cut.lcm"), whole.substr(0, length));
    LogReader reader(path("cut.lcm"));
    EXPECT_EQ(numbers(reader), (std::vector<std::int64_t>{0, 1, 2, 3}));
    ASSERT_EQ(reader.damage().size(), 1u);
    EXPECT_EQ(reader.damage()[0].offset, static_cast<std::int64_t>(offset_of(4)));
    EXPECT_EQ(reader.damage()[0].bytes, static_cast<std::int64_t>(length - offset_of(4)));
  }
}

TEST_F(Log, GoesOnAfterABadHeader) {
  write(path("a.lcm"), 6);
  const std::string whole = text(path("a.lcm"));
  for (const std::size_t byte : {0, 3, 20, 24, 25}) {  // sync word, lengths
    std::string bad = whole;
    bad[offset_of(2) + byte] = '\x7e';
    write_text(path("bad.lcm"), bad);
    LogReader reader(path("bad.lcm"));
    EXPECT_EQ(numbers(reader), (std::vector<std::int64_t>{0, 1, 3, 4, 5})) << "byte " << byte;
    ASSERT_EQ(reader.damage().size(), 1u);
    EXPECT_EQ(reader.damage()[0].offset, static_cast<std::int64_t>(offset_of(2)));
    EXPECT_EQ(reader.damage()[0].bytes, static_cast<std::int64_t>(offset_of(3) - offset_of(2)));
  }
  // Strange bytes before, between and after.
  write_text(path("bad.lcm"), "junk" + whole.substr(0, offset_of(3)) +
                                  std::string(200'000, '\xed') + whole.substr(offset_of(3)) +
                                  "tail");
  LogReader reader(path("bad.lcm"));
  EXPECT_EQ(numbers(reader).size(), 6u);
  EXPECT_EQ(reader.damage().size(), 3u);
}

TEST_F(Log, SurvivesRandomDamage) {
  write(path("a.lcm"), 20);
  const std::string whole = text(path("a.lcm"));
  std::mt19937 random(5);
  for (int round = 0; round < 300; ++round) {
    std::string bad = whole.substr(offset_of(1));
    for (int i = 0; i < 20; ++i) bad[random() % bad.size()] = static_cast<char>(random());
    bad.resize(random() % bad.size());
    write_text(path("bad.lcm"), whole.substr(0, offset_of(1)) + bad);
    LogReader reader(path("bad.lcm"));
    LogEvent event;
    std::int64_t bytes = 0;
    while (reader.next(event))
      bytes += 28 + static_cast<std::int64_t>(event.channel.size() + event.data.size());
    for (const auto& damage : reader.damage()) bytes += damage.bytes;
    EXPECT_EQ(bytes, reader.size());  // every byte is in an event or reported
  }
}

TEST_F(Log, NamesWhatItCannotOpen) {
  EXPECT_THROW(LogReader("/nonexistent.lcm"), Error);
  EXPECT_THROW(LogReader{folder_.string()}, Error);
  EXPECT_THROW(LogWriter("/nonexistent/a.lcm"), Error);
  write_text(path("text.lcm"), "this is no log at all, however long it may be");
  EXPECT_THROW(LogReader(path("text.lcm")), Error);
  write_text(path("empty.lcm"), "");
  LogReader empty(path("empty.lcm"));
  LogEvent event;
  EXPECT_FALSE(empty.next(event));
  LogWriter writer(path("a.lcm"));
  EXPECT_THROW(writer.write(0, "", nullptr, 0), Error);
  EXPECT_THROW(writer.write(0, std::string(64, 'x'), nullptr, 0), Error);
}

TEST_F(Log, SaysWhenTheDiskIsFull) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  LogWriter writer("/dev/full");
  EXPECT_THROW(
      {
        writer.write(0, "A", Bytes(100, 1));
        writer.close();
      },
      Error);
}

}  // namespace
}  // namespace weft::stage
