// Class A of the design for each descriptor: the same bits whichever kernels run, whatever the C
// library's and OpenCV's dispatchers choose, and for every number of threads. The dispatchers
// choose once in a process's life, so each choice is a process of its own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <string>

#include "base/simd.hpp"
#include "support/files.hpp"

namespace weft::descriptor {
namespace {

constexpr const char* kPlainGlibc =
    "GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX512F,-AVX512VL,-AVX2,-AVX,-FMA,-FMA4,-ERMS,-BMI2,-SSE4_2,"
    "-SSE4_1,-SSSE3";
constexpr const char* kPlainOpencv =
    "OPENCV_CPU_DISABLE=AVX512-SKX,AVX512F,AVX2,FMA3,AVX,FP16,SSE4.2,SSE4.1,POPCNT,SSSE3";

std::string run(const std::string& command) {
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) {
    ADD_FAILURE() << "cannot run " << command;
    return "";
  }
  std::string output;
  char buffer[4096];
  while (std::fgets(buffer, sizeof buffer, pipe) != nullptr) {
    // OpenCV says which features it was told to leave out.
    if (buffer[0] != '[') output += buffer;
  }
  EXPECT_EQ(pclose(pipe), 0) << command << "\n" << output;
  return output;
}

std::string hashes(const std::string& environment, const std::string& arguments) {
  return run("env " + environment + " " WEFT_BINARY_DIR "/bin/descriptor-hashes " + arguments +
             " 2>&1");
}

void expect_same_bits(const std::string& scans, std::size_t lines) {
  const auto expected = hashes("", "auto 1" + scans);
  ASSERT_EQ(static_cast<std::size_t>(std::count(expected.begin(), expected.end(), '\n')), lines)
      << expected;
  const std::string plain = std::string(kPlainGlibc) + " " + kPlainOpencv;
  EXPECT_EQ(hashes(plain, "baseline 1" + scans), expected);
  EXPECT_EQ(hashes(kPlainGlibc, "auto 2" + scans), expected);
  EXPECT_EQ(hashes(kPlainOpencv, "auto 3" + scans), expected);
  EXPECT_EQ(hashes("", "baseline 0" + scans), expected);
  if (!simd_path_available(SimdPath::kAvx2)) GTEST_SKIP() << "AVX2: this processor has none";
  EXPECT_EQ(hashes(plain, "avx2 2" + scans), expected);
}

TEST(SameBits, TheCLibraryDoesAsItIsTold) {
  const std::string loader = "/lib64/ld-linux-x86-64.so.2 --help | grep -c 'x86-64-v3 (supp' || :";
  if (!std::filesystem::exists("/lib64/ld-linux-x86-64.so.2") || run(loader) != "1\n")
    GTEST_SKIP() << "AVX2: this processor has none";
  EXPECT_EQ(run("env " + std::string(kPlainGlibc) + " " + loader), "0\n");
}

TEST(SameBits, OnASyntheticScan) { expect_same_bits("", 10); }

TEST(SameBits, OnRealScans) {
  std::string scans;
  for (const char* name :
       {"pcl-scans/office1.pcd", "uc3m-garments/pcd/20150902_towel02_2_fold.pcd"}) {
    const auto path = test::data_folder() / name;
    WEFT_NEEDS_DATA(path);
    scans += " '" + path.string() + "'";
  }
  expect_same_bits(scans, 10 + 2 * 5);
}

}  // namespace
}  // namespace weft::descriptor
