// The process sets of all nine combinations of descriptors: each answers the first frames of the
// shipped log with the same payloads as ever, in one process and in real ones, twice. When an
// answer is meant to change, or models were trained anew:
//   for s in gdh fpfh hks finddd gdh-sift fpfh-sift hks-sift finddd-sift; do
//     weft replay logs/sample.lcm --set config/sets/parts-$s.yaml --to-frame 3 --out out/golden.lcm
//     weft log hash out/golden.lcm > tests/integration/golden/parts-$s.txt
//   done
// parts-sift: golden_test.cpp, the whole log.
#include <gtest/gtest.h>

#include <sstream>
#include <string>

#include "base/text_file.hpp"
#include "support/files.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";
const std::string kSource = WEFT_SOURCE_DIR;

constexpr int kLast = 3;

class NineSets : public testing::TestWithParam<const char*> {};

TEST_P(NineSets, AnswersAsEver) {
  const std::string set = std::string("parts-") + GetParam();
  const test::TemporaryFolder folder;
  const auto played =
      run_command({kWeft, "replay", kSource + "/logs/sample.lcm", "--set",
                   kSource + "/config/sets/" + set + ".yaml", "--out", folder / "out.lcm",
                   "--in-process", "--to-frame", std::to_string(kLast)});
  ASSERT_EQ(played.status, 0) << played.output;
  // Lines of seq, channel and the payload's hash; parts-sift has them of the whole log.
  std::istringstream golden(read_text_file(kSource + "/tests/integration/golden/" + set + ".txt"));
  std::string expected;
  for (std::string line; std::getline(golden, line);)
    if (std::stoi(line) <= kLast) expected += line + "\n";
  const auto hashes = run_command({kWeft, "log", "hash", folder / "out.lcm"});
  ASSERT_EQ(hashes.status, 0) << hashes.output;
  EXPECT_EQ(hashes.output, expected);
}

INSTANTIATE_TEST_SUITE_P(Every, NineSets,
                         testing::Values("sift", "gdh", "fpfh", "hks", "finddd", "gdh-sift",
                                         "fpfh-sift", "hks-sift", "finddd-sift"),
                         [](const auto& set) {
                           std::string name = set.param;
                           std::erase(name, '-');
                           return name;
                         });

}  // namespace
}  // namespace weft
