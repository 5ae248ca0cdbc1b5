#include "messages/words.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "messages/candidates.hpp"
#include "messages/maps.hpp"
#include "stage/stage.hpp"

namespace weft::messages {
namespace {

bovw::WordGrid sample_grid() {
  bovw::WordGrid grid;
  grid.descriptor = "sift";
  grid.vocabulary_hash = 0xfedcba9876543210u;
  grid.vocabulary_size = 4;
  grid.view.sensor = {64, 48, 50.0, 50.0, 32.0, 24.0};
  grid.view.width = 64;
  grid.view.height = 48;
  grid.origin_x = 6;
  grid.origin_y = 7;
  grid.step_px = 6;
  grid.columns = 3;
  grid.rows = 2;
  grid.cells = {-2, -1, 0, 3, 2, 1};
  return grid;
}

TEST(Words, SurviveTheMessage) {
  const auto grid = sample_grid();
  words_t message;
  to_message(grid, message);
  const auto back = from_message(message);
  EXPECT_EQ(back.descriptor, "sift");
  EXPECT_EQ(back.vocabulary_hash, grid.vocabulary_hash);
  EXPECT_EQ(back.vocabulary_size, 4);
  EXPECT_EQ(back.view.width, 64);
  EXPECT_EQ(back.origin_y, 7.0);
  EXPECT_EQ(back.step_px, 6.0);
  EXPECT_EQ(back.columns, 3);
  EXPECT_EQ(back.rows, 2);
  EXPECT_EQ(back.cells, grid.cells);
}

TEST(Words, ImpossibleContentIsRefused) {
  words_t good;
  to_message(sample_grid(), good);
  const auto refused = [&](auto change) {
    words_t bad = good;
    change(bad);
    EXPECT_THROW(from_message(bad), stage::InvalidInput);
  };
  refused([](words_t& m) { m.descriptor.clear(); });
  refused([](words_t& m) { m.vocabulary_size = 3; });  // a cell holds word 3
  refused([](words_t& m) { m.vocabulary_size = 0; });
  refused([](words_t& m) { m.vocabulary_size = 40000; });
  refused([](words_t& m) { m.cells[0] = -3; });
  refused([](words_t& m) { m.columns = 2; });
  refused([](words_t& m) { m.columns = -3, m.rows = -2; });
  refused([](words_t& m) { m.columns = 1 << 30, m.rows = 1 << 30; });
  refused([](words_t& m) { m.cells.pop_back(); });
  refused([](words_t& m) { m.step_px = 0; });
  refused([](words_t& m) { m.origin_x = std::numeric_limits<double>::quiet_NaN(); });
  refused([](words_t& m) { m.view.width = 0; });
}

TEST(Candidates, SurviveTheMessageAndAreChecked) {
  part_candidates_t message;
  to_message({{"polo collar", 3, 4, 0.5, 0.25}, {"jeans hips", 0, 0, 1.0, 1.0}}, 7, message);
  EXPECT_EQ(message.candidate_count, 2);
  EXPECT_EQ(message.model_hash, 7);
  const auto back = from_message(message);
  ASSERT_EQ(back.size(), 2u);
  EXPECT_EQ(back[0].part, "polo collar");
  EXPECT_EQ(back[0].column, 3);
  EXPECT_EQ(back[0].row, 4);
  EXPECT_EQ(back[0].probability, 0.5);
  EXPECT_EQ(back[0].prior, 0.25);
  const auto refused = [&](auto change) {
    auto bad = message;
    change(bad.candidates[0]);
    EXPECT_THROW(from_message(bad), stage::InvalidInput);
  };
  refused([](part_candidate_t& m) { m.part = "sock"; });
  refused([](part_candidate_t& m) { m.column = -1; });
  refused([](part_candidate_t& m) { m.probability = 1.5; });
  refused([](part_candidate_t& m) { m.prior = std::numeric_limits<double>::quiet_NaN(); });
}

TEST(Maps, SurviveTheMessageAndAreChecked) {
  const auto grid = sample_grid();
  probability_map_t message;
  to_message({{"polo collar", 0.5, {0, 1, 2, 3, 4, 255}}}, grid, message);
  const auto back = from_message(message);
  EXPECT_EQ(back.columns, 3);
  EXPECT_EQ(back.step_px, 6.0);
  ASSERT_EQ(back.maps.size(), 1u);
  EXPECT_EQ(back.maps[0].full_scale, 0.5);
  EXPECT_EQ(back.maps[0].values, (std::vector<std::uint8_t>{0, 1, 2, 3, 4, 255}));
  EXPECT_THROW(to_message({{"polo collar", 0.5, {0, 1}}}, grid, message), Error);
  const auto refused = [&](auto change) {
    auto bad = message;
    to_message({{"polo collar", 0.5, {0, 1, 2, 3, 4, 255}}}, grid, bad);
    change(bad);
    EXPECT_THROW(from_message(bad), stage::InvalidInput);
  };
  refused([](probability_map_t& m) { m.columns = 4; });
  refused([](probability_map_t& m) { m.maps[0].part = "sock"; });
  refused([](probability_map_t& m) { m.maps[0].full_scale = 2.0; });
  refused([](probability_map_t& m) { m.maps.push_back(m.maps[0]); });
  refused([](probability_map_t& m) { m.step_px = -1.0; });
}

// What is too large for a message becomes coarser: each value is the largest of those it covers.
TEST(Maps, LargeGridsAreReduced) {
  auto grid = sample_grid();
  grid.columns = 201;
  grid.rows = 180;
  grid.cells.assign(201 * 180, 0);
  std::vector<detector::ProbabilityMap> maps;
  for (std::size_t p = 0; p < 11; ++p) {
    maps.push_back({detector::kParts[p], 1.0, std::vector<std::uint8_t>(201 * 180)});
    for (std::size_t i = 0; i < maps[p].values.size(); ++i)
      maps[p].values[i] = static_cast<std::uint8_t>((i * 7919 + p) % 251);
  }
  probability_map_t message;
  to_message(maps, grid, message);
  EXPECT_LT(message.getEncodedSize(), 160'000);
  const auto back = from_message(message);
  EXPECT_EQ(back.step_px, 12.0);
  EXPECT_EQ(back.origin_x, 9.0);  // the middle of two points
  EXPECT_EQ(back.columns, 101);
  EXPECT_EQ(back.rows, 90);
  for (const int row : {0, 17, 89}) {
    for (const int column : {0, 50, 100}) {
      std::uint8_t most = 0;
      for (int y = 2 * row; y < 2 * row + 2; ++y) {
        for (int x = 2 * column; x < std::min(201, 2 * column + 2); ++x)
          most = std::max(most, maps[3].values[static_cast<std::size_t>(y * 201 + x)]);
      }
      EXPECT_EQ(back.maps[3].values[static_cast<std::size_t>(row * 101 + column)], most);
    }
  }
}

}  // namespace
}  // namespace weft::messages
