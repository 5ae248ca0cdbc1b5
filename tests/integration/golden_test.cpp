// The shipped set on the shipped log, payload for payload. When an answer is meant to change, or
// models were trained anew:
//   weft replay logs/sample.lcm --set config/sets/parts-sift.yaml --out out/golden.lcm
//   weft log hash out/golden.lcm > tests/integration/golden/parts-sift.txt
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "base/text_file.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";
const std::string kSource = WEFT_SOURCE_DIR;

class Golden : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(kSource + "/logs/sample.lcm")) GTEST_SKIP() << "there is no logs/sample.lcm";
    folder_ = fs::temp_directory_path() / ("weft-golden-" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override {
    if (!folder_.empty() && !HasFailure()) fs::remove_all(folder_);
  }
  CommandResult replay(const std::vector<std::string>& more) const {
    std::vector<std::string> args{kWeft,
                                  "replay",
                                  kSource + "/logs/sample.lcm",
                                  "--set",
                                  kSource + "/config/sets/parts-sift.yaml",
                                  "--out",
                                  (folder_ / "out.lcm").string()};
    args.insert(args.end(), more.begin(), more.end());
    return run_command(args);
  }
  void expect_golden() const {
    const auto expected = read_text_file(kSource + "/tests/integration/golden/parts-sift.txt");
    const auto hashes = run_command({kWeft, "log", "hash", (folder_ / "out.lcm").string()});
    ASSERT_EQ(hashes.status, 0) << hashes.output;
    if (hashes.output == expected) return;
    const auto at = static_cast<std::size_t>(
        std::mismatch(expected.begin(), expected.end(), hashes.output.begin(), hashes.output.end())
            .first -
        expected.begin());
    const auto line = [&](const std::string& text) {
      const auto begin = text.rfind('\n', at) + 1;
      return text.substr(begin, text.find('\n', begin) - begin);
    };
    FAIL() << "first difference, expected and now (seq, channel, hash):\n"
           << line(expected) << "\n"
           << line(hashes.output) << "\nSee the top of " << __FILE__;
  }
  fs::path folder_;
};

TEST_F(Golden, AllStagesInOneProcess) {
  const auto result = replay({"--in-process"});
  ASSERT_EQ(result.status, 0) << result.output;
  expect_golden();
}

TEST_F(Golden, RealProcessesTwice) {
  const auto result = replay({"--verify"});
  ASSERT_EQ(result.status, 0) << result.output;
  expect_golden();
}

}  // namespace
}  // namespace weft
