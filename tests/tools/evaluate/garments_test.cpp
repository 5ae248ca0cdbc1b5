#include <gtest/gtest.h>

#include "support/files.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

TEST(EvaluateGarments, SaysWhatIsMissing) {
  const test::TemporaryFolder folder;
  const auto run = [&] {
    return run_command({std::string(WEFT_BINARY_DIR) + "/bin/weft-evaluate", "garments",
                        folder / "map.lcm", "--truth", folder.string()});
  };
  auto result = run();
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.output.find("garments.json is not there"), std::string::npos) << result.output;
  test::write_bytes(folder / "garments.json", "{\"garments\": 7}");
  result = run();
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.output.find("a list \"garments\" is missing"), std::string::npos)
      << result.output;
  test::write_bytes(folder / "garments.json", "{\"garments\": []}");
  result = run();  // a folder without pictures is no recording
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.output.find(folder.string()), std::string::npos) << result.output;
}

}  // namespace
}  // namespace weft
