#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "support/files.hpp"

/// weft evaluate trajectory, as a program.
namespace weft {
namespace {

int run(const std::string& arguments, const std::string& output) {
  const std::string command = std::string(WEFT_BINARY_DIR) + "/bin/weft-evaluate trajectory " +
                              arguments + " >" + output + " 2>&1";
  return WEXITSTATUS(std::system(command.c_str()));
}

TEST(EvaluateTrajectory, WritesTheFigures) {
  const test::TemporaryFolder folder;
  std::string truth = "# truth\n", estimate;
  for (int i = 0; i < 4; ++i) {
    const auto stamp = std::to_string(100 + i), y = std::to_string(i * i);
    truth += stamp + " " + std::to_string(i) + " " + y + " 0 0 0 0 1\n";
    if (i < 3)
      estimate += stamp + ".004 " + y + " " + std::to_string(-i) + " 5 0 0 -0.7071 0.7071\n";
  }
  test::write_bytes(folder / "truth.txt", truth);
  test::write_bytes(folder / "estimate.txt", estimate);
  ASSERT_EQ(run((folder / "estimate.txt") + " --truth " + (folder / "truth.txt") + " --json " +
                    (folder / "a.json"),
                folder / "out"),
            0)
      << test::read_bytes(folder / "out");
  const auto json = nlohmann::json::parse(test::read_bytes(folder / "a.json"));
  EXPECT_LT(json.at("ate_rmse_m").get<double>(), 1e-12);
  EXPECT_EQ(json.at("poses"), 3);
  EXPECT_EQ(json.at("frames"), 4);
  EXPECT_EQ(run((folder / "estimate.txt") + " --truth " + (folder / "truth.txt") +
                    " --set max_time_difference_s=0.003",
                folder / "out"),
            1);
  EXPECT_NE(test::read_bytes(folder / "out").find("no pose has a truth"), std::string::npos);
  EXPECT_EQ(run("/no/such.txt --truth " + (folder / "truth.txt"), folder / "out"), 1);
  EXPECT_NE(test::read_bytes(folder / "out").find("/no/such.txt"), std::string::npos);
  EXPECT_EQ(run((folder / "estimate.txt"), folder / "out"), 2);
}

}  // namespace
}  // namespace weft
