#include "synth/invariance.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "procedural.hpp"

namespace weft::synth {
namespace {

TEST(Invariance, UprightSiftStandsNoiseButNotAQuarterTurn) {
  const auto file =
      std::filesystem::temp_directory_path() / ("invariance-" + std::to_string(getpid()) + ".wsim");
  write_simulation(file.string(), test::procedural_sack("sack", 0.004f));
  bovw::DescribeOptions sensor, rectified;
  sensor.view.rectified = false;
  const auto results = measure_invariance(
      {file.string()}, {sensor, rectified},
      {{Change::kNoise, 1.0}, {Change::kTurn, 90.0}, {Change::kDistance, 1.2}}, 2, [](int, int) {});
  std::filesystem::remove(file);
  ASSERT_EQ(results.size(), 2u);
  for (const auto& result : results) {
    ASSERT_EQ(result.size(), 3u);
    EXPECT_GT(result[0].points, 500);
    EXPECT_GT(result[0].described, 0.9);
    EXPECT_GT(result[0].stability, 0.95);
    EXPECT_LT(result[1].stability, result[0].stability - 0.1);
  }
  // Seen from half as far again, only the rectified view shows the same size.
  EXPECT_GT(results[1][2].stability, results[0][2].stability);
}

TEST(InvariancePlot, HasALineForEachDescriptorViewAndChange) {
  std::vector<std::vector<MatchStability>> stabilities(2);
  for (auto& each : stabilities)
    for (const auto& change : plotted_changes()) each.push_back({change, 0.9, 1.0, 10});
  const auto svg = invariance_plot({"sift", "fpfh"}, stabilities, stabilities);
  int lines = 0;
  for (auto at = svg.find("<polyline"); at != std::string::npos; at = svg.find("<polyline", at + 1))
    ++lines;
  EXPECT_EQ(lines, 2 * 2 * 4);
  EXPECT_NE(svg.find(">fpfh<"), std::string::npos);
}

}  // namespace
}  // namespace weft::synth
