#include "messages/foreground.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "base/random.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

using foreground::Foreground;

Foreground random_foreground(int garment_of_100, bool first) {
  Random random(static_cast<std::uint64_t>(garment_of_100) + 1);
  Foreground result;
  result.mask.create(30, 40, CV_8UC1);
  for (int i = 0; i < 1200; ++i)
    result.mask.data[i] = static_cast<int>(random.below(100)) < garment_of_100 ? 255 : 0;
  result.mask.data[0] = first ? 255 : 0;
  result.source = Foreground::Source::kDataset;
  result.table = rgbd::Plane{};
  result.table->distance_m = -0.7;
  result.table->support = 12;
  return result;
}

TEST(ForegroundMessage, CarriesEveryMask) {
  for (const int share : {0, 3, 50, 97, 100})
    for (const bool first : {false, true}) {
      const Foreground foreground = random_foreground(share, first);
      foreground_t message;
      to_message(foreground, message);
      EXPECT_EQ(message.garment_px, cv::countNonZero(foreground.mask));
      const Foreground back = from_message(message);
      EXPECT_EQ(cv::norm(back.mask, foreground.mask, cv::NORM_INF), 0.0);
      EXPECT_EQ(back.source, Foreground::Source::kDataset);
      ASSERT_TRUE(back.table);
      EXPECT_EQ(back.table->distance_m, -0.7);
      EXPECT_EQ(back.table->support, 12);
    }
}

TEST(ForegroundMessage, CarriesTheAbsenceOfATable) {
  Foreground foreground = random_foreground(10, false);
  foreground.table.reset();
  foreground.source = Foreground::Source::kLive;
  foreground_t message;
  to_message(foreground, message);
  EXPECT_FALSE(from_message(message).table);
  EXPECT_EQ(from_message(message).source, Foreground::Source::kLive);
}

TEST(ForegroundMessage, RefusesImpossibleContent) {
  const auto refused = [](auto change) {
    foreground_t message;
    to_message(random_foreground(50, false), message);
    change(message);
    EXPECT_THROW(from_message(message), stage::InvalidInput);
  };
  refused([](foreground_t& m) { m.source = 9; });
  refused([](foreground_t& m) { m.width = 0; });
  refused([](foreground_t& m) { m.height = 100000; });
  refused([](foreground_t& m) { m.width = 41; });
  refused([](foreground_t& m) { m.runs[1] = 0; });
  refused([](foreground_t& m) { m.runs[1] = -5; });
  refused([](foreground_t& m) { m.runs[1] = 2000000000; });
  refused([](foreground_t& m) { m.runs.pop_back(); });
  refused([](foreground_t& m) { m.runs.clear(); });
  refused([](foreground_t& m) { ++m.garment_px; });
  refused([](foreground_t& m) { m.table.normal[0] = 2.0; });
}

}  // namespace
}  // namespace weft::messages
