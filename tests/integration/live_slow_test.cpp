// Every shipped set, live, with LCM's own lcm-logplayer and lcm-logger as in docs/replay.md: what
// is lost is counted.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/text_file.hpp"
#include "integration/set_replay.hpp"
#include "stage/log.hpp"
#include "stage/net_namespace.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

// Arguments: weft, the test's folder, the set, the log.
const char* const kScript = R"SCRIPT(
set -eu
weft=$1
cd "$2"
export WEFT_RUN_DIR=$PWD/run
trap '"$weft" down || true' EXIT
"$weft" log filter "$4" --channel RGBD_FRAME --out sources.lcm
"$weft" up "$3"
url='udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304'
lcm-logger --lcm-url="$url" recorded.lcm & logger=$!
sleep 1
lcm-logplayer --lcm-url="$url" sources.lcm
frames=-1
for i in $(seq 60); do  # until nobody answers any more
  sleep 2
  "$weft" status --json status.json
  now=$(grep -o '"frames_\(out\|dropped\|failed\|missing_input\)": *[0-9]*' status.json | md5sum)
  [ "$now" != "$frames" ] || break
  frames=$now
done
kill $logger
wait $logger || true
)SCRIPT";

class LiveSets : public testing::TestWithParam<std::string> {};

TEST_P(LiveSets, NothingIsLostInSilence) {
  const std::string set = GetParam();
  if (const auto why = test::why_not(set); !why.empty()) GTEST_SKIP() << why;
  for (const std::string program : {"supervisord", "lcm-logplayer", "lcm-logger"}) {
    if (run_command({"sh", "-c", "command -v " + program}).status != 0)
      GTEST_SKIP() << "no " << program;
  }
  const auto folder = fs::temp_directory_path() / ("weft-live-" + std::to_string(getpid()));
  fs::create_directories(folder);
  write_text_file(folder / "script", kScript);
  const std::string log = WEFT_SOURCE_DIR "/logs/sample.lcm";
  const pid_t pid = fork();
  if (pid == 0) {
    std::string why;
    if (!stage::enter_private_network(why)) _exit(3);
    const auto result = run_command({"timeout", "300", "bash", (folder / "script").string(),
                                     WEFT_BINARY_DIR "/bin/weft", folder.string(),
                                     test::set_file(set).string(), log});
    std::fputs(result.output.c_str(), stderr);
    _exit(result.status);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  ASSERT_EQ(status, 0);

  const auto frames = [](const fs::path& file) {
    std::map<std::string, std::map<std::int64_t, int>> seen;  // by channel and seq: the status
    stage::LogReader reader(file.string());
    for (stage::LogEvent event; reader.next(event);) {
      if (event.channel.starts_with("STAGE_")) continue;
      if (const auto header = read_frame_header(event.data))
        seen[event.channel].emplace(header->frame.seq, header->status_code);
    }
    EXPECT_TRUE(reader.damage().empty());
    return seen;
  };
  const auto played = static_cast<int>(frames(folder / "sources.lcm")["RGBD_FRAME"].size());
  const auto json = nlohmann::json::parse(read_text_file(folder / "status.json"))["processes"];
  ASSERT_FALSE(json.empty());
  for (const auto& [name, process] : json.items()) {
    int said = 0;
    for (const char* what : {"out", "dropped", "failed", "missing_input"})
      said += process["frames_" + std::string(what)].get<int>();
    const int gaps = process["gaps"];
    std::printf("%s: %d of %d played, %d answered, %d dropped, %d missing input, %d gaps\n",
                name.c_str(), said + gaps, played, process["frames_out"].get<int>(),
                process["frames_dropped"].get<int>(), process["frames_missing_input"].get<int>(),
                gaps);
    EXPECT_EQ(said + gaps, played) << name;
  }
  // What the logger has of each channel is every frame, or less by what it lost itself.
  for (const auto& [channel, seen] : frames(folder / "recorded.lcm"))
    EXPECT_GE(static_cast<int>(seen.size()), played * 9 / 10) << channel;
  if (!HasFailure()) fs::remove_all(folder);
}

INSTANTIATE_TEST_SUITE_P(Shipped, LiveSets, testing::ValuesIn(test::shipped_sets()),
                         [](const auto& set) {
                           std::string name = set.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace weft
