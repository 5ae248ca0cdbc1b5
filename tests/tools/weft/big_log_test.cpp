// A log of more than 3 GB, damaged, through every log command: each a process of its own whose
// peak memory the kernel tells.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/text_file.hpp"
#include "integration/test_log.hpp"
#include "support/files.hpp"

namespace weft {
namespace {

constexpr std::int64_t kEvents = 21'500, kDamagedEvery = 1000;
constexpr std::size_t kBytes = 150'000;

struct Run {
  int status = -1;
  long peak_kb = 0;
  double cpu_s = 0;
};

Run weft_log(std::vector<std::string> args, const std::string& output) {
  args.insert(args.begin(), {WEFT_BINARY_DIR "/bin/weft", "log"});
  std::vector<char*> argv;
  for (auto& arg : args) argv.push_back(arg.data());
  argv.push_back(nullptr);
  const pid_t pid = fork();
  if (pid == 0) {
    const int file = open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    dup2(file, STDOUT_FILENO);
    dup2(file, STDERR_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  int status = 0;
  rusage usage{};
  wait4(pid, &status, 0, &usage);
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, usage.ru_maxrss,
          static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec)};
}

void put(std::uint8_t* at, std::int64_t value, int bytes) {
  for (int i = bytes - 1; i >= 0; --i, value >>= 8) at[i] = static_cast<std::uint8_t>(value);
}

/// Images of zeros, which take no place on the disk. Every kDamagedEvery-th event has a broken sync
/// word; the last one is cut off.
void write_big_log(const std::string& path) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  ASSERT_GE(file, 0);
  weft::rgbd_frame_t frame{};
  frame.header = {1, "camera", 7, 2, "camera"};
  frame.source = "scene";
  frame.camera_model = {320, 240, 262.5, 262.5, 159.5, 119.5};
  frame.depth_unit_m = 0.001;
  frame.part_count = 1;
  frame.data.resize(kBytes);
  frame.data_size = frame.colour_size = static_cast<std::int32_t>(kBytes);
  const std::string channel = "RGBD_FRAME";
  const auto data_bytes = static_cast<std::size_t>(frame.getEncodedSize());
  const std::size_t head = 28 + channel.size();
  std::vector<std::uint8_t> event(head + data_bytes);
  put(&event[0], 0xEDA1DA01, 4);
  put(&event[20], static_cast<std::int64_t>(channel.size()), 4);
  put(&event[24], static_cast<std::int64_t>(data_bytes), 4);
  std::copy(channel.begin(), channel.end(), event.begin() + 28);
  frame.encode(&event[head], 0, static_cast<int>(data_bytes));
  // After the fingerprint: utime, the camera's length and name, the session, seq.
  const std::size_t utime_at = head + 8, seq_at = utime_at + 8 + 4 + 7 + 8;
  ASSERT_EQ(event[seq_at + 7], 2);
  off_t at = 0;
  for (std::int64_t seq = 0; seq < kEvents; ++seq) {
    const auto utime = 1'700'000'000'000'000 + seq * 33'333;
    event[1] = seq % kDamagedEvery == kDamagedEvery / 2 ? 0 : 0xA1;
    put(&event[4], seq, 8);
    put(&event[12], utime, 8);
    put(&event[utime_at], utime, 8);
    put(&event[seq_at], seq, 8);
    ASSERT_EQ(pwrite(file, event.data(), 1000, at), 1000);
    at += static_cast<off_t>(event.size());
  }
  ASSERT_EQ(ftruncate(file, at - 1234), 0);
  close(file);
}

TEST(BigLog, EveryCommandTakesItInConstantMemory) {
  const test::TemporaryFolder folder;
  const auto big = folder / "big.lcm", out = folder / "out.lcm", json = folder / "out.json",
             said = folder / "said.txt";
  write_big_log(big);
  if (HasFatalFailure()) return;
  const auto bytes = static_cast<std::int64_t>(std::filesystem::file_size(big));
  ASSERT_GT(bytes, std::int64_t{3} << 30);
  const auto space = std::filesystem::space(folder.string());
  if (space.available < static_cast<std::uintmax_t>(bytes) * 2)
    GTEST_SKIP() << "no room for two logs of " << bytes / 1'000'000
                 << " MB in the temporary folder";
  const auto time = std::filesystem::last_write_time(big);
  test_stage::write_test_log(folder / "small.lcm", 2, 1000);
  const auto small = weft_log({"info", folder / "small.lcm"}, said);
  constexpr std::int64_t kDamaged = kEvents / kDamagedEvery, kWhole = kEvents - kDamaged - 1;
  const std::vector<std::pair<std::vector<std::string>, int>> commands = {
      {{"info", big, "--json", json}, 1},
      {{"check", big, "--json", json}, 1},
      {{"repair", big, "--out", out}, 0},
      {{"filter", big, "--channel", "RGBD_.*", "--out", out}, 0},
      {{"cut", big, "--from-frame", "20000", "--to-frame", "20099", "--out", out}, 0},
      {{"splice", big, big, "--out", out}, 0}};
  for (const auto& [args, status] : commands) {
    const auto run = weft_log(args, said);
    EXPECT_EQ(run.status, status) << args[0] << "\n" << read_text_file(said);
    EXPECT_LT(run.peak_kb, small.peak_kb + 16 * 1024) << args[0] << ", KB";
    std::printf("%s: peak %ld KB (a log of two frames: %ld), %.0f s CPU\n", args[0].c_str(),
                run.peak_kb, small.peak_kb, run.cpu_s);
    std::fflush(stdout);
    const auto text = read_text_file(said);
    if (args[0] == "check") {
      const auto survey = nlohmann::json::parse(read_text_file(json));
      EXPECT_EQ(survey["events"], kWhole);
      EXPECT_EQ(survey["problems_found"], kDamaged + 1);
      EXPECT_EQ(survey["channels"]["RGBD_FRAME"]["missing"], kDamaged);
    }
    const std::string written = std::to_string(args[0] == "cut" ? 100 : kWhole);
    if (status == 0) {
      EXPECT_NE(text.find(": " + written + " of "), std::string::npos) << text;
    }
  }
  EXPECT_EQ(static_cast<std::int64_t>(std::filesystem::file_size(big)), bytes);
  EXPECT_EQ(std::filesystem::last_write_time(big), time) << "the input was touched";
}

}  // namespace
}  // namespace weft
