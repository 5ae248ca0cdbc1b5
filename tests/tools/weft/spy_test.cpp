#include "tools/weft/spy.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "lib/stage/fake_stage.hpp"
#include "tools/weft/message.hpp"
#include "weft/part_detections_t.hpp"

namespace weft {
namespace {

std::vector<std::uint8_t> detections(std::int64_t seq, std::int8_t code) {
  auto message = stage::fake::message<part_detections_t>(stage::fake::header(seq));
  message.status.code = code;
  return encode_message(message);
}

TEST(Spy, CountsRatesGapsAndFaults) {
  SpyTable table(MessageTypes::built_in());
  std::int64_t time = 1'000'000;
  for (std::int64_t seq = 0; seq < 40; ++seq, time += 50'000) {
    if (seq == 7 || seq == 8) continue;
    table.add({"PART_DETECTIONS", detections(seq, seq == 3 ? status_t::FAILED : status_t::OK)},
              time);
    table.add({"OTHER", {1, 2, 3}}, time);
  }
  auto damaged = detections(41, 0);
  damaged.pop_back();
  table.add({"PART_DETECTIONS", damaged}, time);
  const auto rows = table.rows(time, 1.0);
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0].channel, "OTHER");
  EXPECT_EQ(rows[0].type, "");
  EXPECT_NEAR(rows[0].bytes_per_second, 60, 3.1);
  const auto& found = rows[1];
  EXPECT_EQ(found.type, "part_detections_t");
  EXPECT_EQ(found.messages, 39);
  EXPECT_NEAR(found.per_second, 20, 1.1);
  EXPECT_EQ(found.missing, 2);
  EXPECT_EQ(found.not_ok, 1);
  EXPECT_EQ(found.damaged, 1);
  EXPECT_NEAR(found.longest_gap_s, 0.15, 1e-9);
  EXPECT_NEAR(table.rows(time + 3'000'000, 1.0)[1].longest_gap_s, 3.0, 1e-9);
  EXPECT_EQ(table.rows(time + 3'000'000, 1.0)[1].per_second, 0);
  EXPECT_NE(to_text(rows).find("PART_DETECTIONS"), std::string::npos);
}

TEST(Spy, NamesThatNobodyCanReadAndTooManyNamesAreCountedTogether) {
  const auto types = MessageTypes::built_in();
  SpyTable table(types);
  for (const std::string name : {"", "\033[2J", "A\nB", "\xff"}) table.add({name, {1}}, 1);
  table.add({std::string(64, 'x'), {1}}, 1);
  auto rows = table.rows(2, 1.0);
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].channel, "(unreadable)");
  EXPECT_EQ(rows[0].messages, 5);
  for (int i = 0; i < 3000; ++i) table.add({"C" + std::to_string(i), {1}}, 1);
  rows = table.rows(2, 1.0);
  EXPECT_EQ(rows.size(), 1001u);
  const auto more = std::find_if(rows.begin(), rows.end(),
                                 [](const SpyRow& row) { return row.channel == "(more)"; });
  ASSERT_NE(more, rows.end());
  EXPECT_EQ(more->messages, 3000 - 999);
}

TEST(Spy, ShowsFieldsWithArraysInALine) {
  SpyTable table(MessageTypes::built_in());
  auto words = stage::fake::message<words_t>(stage::fake::header(1));
  for (int i = 0; i < 100; ++i) words.cells.push_back(static_cast<std::int16_t>(i));
  words.cell_count = 100;
  table.add({"WORDS", encode_message(words)}, 1);
  const auto lines = table.fields("WORDS");
  const auto has = [&](const std::string& line) {
    return std::find(lines.begin(), lines.end(), line) != lines.end();
  };
  EXPECT_EQ(lines.front(), "words_t");
  EXPECT_TRUE(has("header.seq: 1"));
  EXPECT_TRUE(has("cells[100]: 0 1 2 3 4 5 6 7 8 9 10 11 ..."));
  EXPECT_TRUE(has("view.table.normal[3]: 0 0 0"));
  EXPECT_EQ(table.fields("NONE").front(), "no message was heard on NONE");
  table.add({"X", {1, 2}}, 2);
  EXPECT_NE(table.fields("X").front().find("2 bytes of an unknown type"), std::string::npos);
}

}  // namespace
}  // namespace weft
