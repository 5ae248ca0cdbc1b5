#include "base/text_file.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "support/files.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

class TextFile : public testing::Test {
 protected:
  const test::TemporaryFolder temporary_;
  const fs::path folder_ = temporary_.string();
};

TEST_F(TextFile, ComesBackByteForByteAndLeavesNothingBeside) {
  const std::string text("a\r\n\0\xff", 5);
  write_text_file(folder_ / "made" / "file", "something longer that is replaced");
  write_text_file(folder_ / "made" / "file", text);
  EXPECT_EQ(read_text_file(folder_ / "made" / "file"), text);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "made"), {}), 1);
}

TEST_F(TextFile, OneThatIsMissingIsEmpty) { EXPECT_EQ(read_text_file(folder_ / "none"), ""); }

TEST_F(TextFile, ADeviceIsWrittenToAndKept) {
  write_text_file("/dev/null", "x");
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST_F(TextFile, SaysWhatCannotBeWritten) {
  write_text_file(folder_ / "file", "x");
  try {
    write_text_file(folder_ / "file" / "below", "x");
    FAIL() << "wrote below a file";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find((folder_ / "file" / "below").string()),
              std::string::npos)
        << error.what();
  }
}

}  // namespace
}  // namespace weft
