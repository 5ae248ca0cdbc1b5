#include "tools/weft/source_log.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "integration/test_log.hpp"

namespace weft {
namespace {

std::string temporary(const std::string& name) {
  return testing::TempDir() + "source_log_test_" + name;
}

TEST(SourceLog, PlaysOnlySourceChannelsAndLeavesRepeatsOut) {
  const auto file = temporary("source.lcm");
  stage::LogWriter writer(file);
  const auto first = test_stage::test_event(0, 100), second = test_stage::test_event(1, 100);
  for (const auto& event : {first, second, first}) writer.write(1, event.channel, event.data);
  writer.write(1, "PART_DETECTIONS", std::vector<std::uint8_t>{1});
  writer.close();
  SourceLog log(file, {"RGBD_FRAME"});
  ASSERT_EQ(log.size(), 2u);
  EXPECT_EQ(log.read(0).events.size(), 1u);
  EXPECT_EQ(log.read(1).name.seq, 1);
  EXPECT_EQ(log.read(1).events[0].data, second.data);
}

TEST(SourceLog, LaterPassesGoOnWhereTheFirstEnded) {
  const auto file = temporary("loop.lcm");
  test_stage::write_test_log(file, 3, 100);
  SourceLog log(file, {"RGBD_FRAME"});
  ASSERT_EQ(log.size(), 3u);
  for (std::size_t i = 0; i < 9; ++i) {
    const auto frame = log.read(i);
    EXPECT_EQ(frame.name.seq, static_cast<std::int64_t>(i));
    EXPECT_EQ(frame.utime, 1'700'000'000'000'000 + static_cast<std::int64_t>(i) * 100'000);
    const auto header = read_frame_header(frame.events[0].data);
    ASSERT_TRUE(header);
    EXPECT_EQ(header->frame, frame.name);
    EXPECT_EQ(header->utime, frame.utime);
  }
  weft::rgbd_frame_t original, renamed;
  const auto a = log.read(1).events[0].data, b = log.read(4).events[0].data;
  ASSERT_GT(original.decode(a.data(), 0, static_cast<int>(a.size())), 0);
  ASSERT_GT(renamed.decode(b.data(), 0, static_cast<int>(b.size())), 0);
  EXPECT_EQ(original.data, renamed.data);
  EXPECT_EQ(original.source, renamed.source);
}

TEST(SourceLog, SaysWhatTheLogHoldsInstead) {
  const auto file = temporary("other.lcm");
  test_stage::write_test_log(file, 1, 100);
  try {
    SourceLog(file, {"KEYFRAME"});
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("no frame on KEYFRAME; the log holds FOREGROUND, "
                                         "LCM_SELF_TEST, RGBD_FRAME"),
              std::string::npos)
        << e.what();
  }
}

TEST(FrameName, GarbageHasNoHeader) {
  Random random(1);
  const auto good = test_stage::test_event(0, 10).data;
  for (int i = 0; i < 2000; ++i) {
    auto bytes = good;
    bytes.resize(random.below(bytes.size()) + 1);
    for (int k = 0; k < 5; ++k)
      bytes[random.below(bytes.size())] = static_cast<std::uint8_t>(random.bits());
    read_frame_header(bytes);  // must return
  }
  EXPECT_FALSE(read_frame_header({}));
  EXPECT_FALSE(read_frame_header(std::vector<std::uint8_t>(8)));
  EXPECT_THROW(rename_frame({1, 2}, 0, 0), Error);
}

}  // namespace
}  // namespace weft
