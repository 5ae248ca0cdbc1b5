// One set on two hosts: two network namespaces with host names of their own, joined by a cable, and
// LCM's own lcm-logplayer and lcm-logger on them.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "base/text_file.hpp"
#include "integration/test_log.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

constexpr int kFrames = 60;

// Arguments: weft, the test's folder. Host host-a is this shell, host-b the namespaces of $b.
const char* const kScript = R"(
set -eu
weft=$1
cd "$2"
hostname host-a
unshare -n -u sh -c 'hostname host-b; exec sleep 80' & b=$!
sleep 1
on_b() { nsenter -t $b -n -u env WEFT_RUN_DIR="$PWD/b" "$@"; }
on_a() { env WEFT_RUN_DIR="$PWD/a" "$@"; }
trap 'on_b "$weft" down || true; on_a "$weft" down || true; kill $b' EXIT
ip link add cable type veth peer name cable netns $b
ip address add 10.9.0.1/24 dev cable
on_b ip address add 10.9.0.2/24 dev cable
for host in on_a on_b; do
  $host ip link set lo up
  $host ip link set cable up
  $host ip route add 224.0.0.0/4 dev cable
done
on_a "$weft" up set.yaml
on_b "$weft" up set.yaml
url='udpm://239.255.76.67:7667?ttl=1&recv_buf_size=4194304'
nsenter -t $b -n -u lcm-logger --lcm-url="$url" recorded.lcm & logger=$!
sleep 1
on_a lcm-logplayer --lcm-url="$url" in.lcm & player=$!
sleep 1
# Host b as one that runs nothing of the set.
nsenter -t $b -n -u env WEFT_RUN_DIR="$PWD/none" "$weft" status set.yaml --listen-s 5 --json guest.json || true
wait $player
sleep 2
on_a "$weft" status set.yaml --json status.json
kill $logger
wait $logger || true
)";

TEST(Lan, OneSetOnTwoHostsIsPlayedAndRecordedByLcmsOwnTools) {
  if (run_command({"unshare", "-n", "-u", "true"}).status != 0 || geteuid() != 0)
    GTEST_SKIP() << "network namespaces joined by a cable need root";
  for (const char* program : {"supervisord", "lcm-logplayer", "lcm-logger", "nsenter", "ip"}) {
    if (run_command({"sh", "-c", std::string("command -v ") + program}).status != 0)
      GTEST_SKIP() << "no " << program;
  }
  const auto folder = fs::temp_directory_path() / ("weft-lan-" + std::to_string(getpid()));
  fs::create_directories(folder);
  {
    stage::LogWriter log((folder / "in.lcm").string());
    for (int seq = 0; seq < kFrames; ++seq)
      log.write(1'000'000 + seq * 100'000, "RGBD_FRAME", test_stage::test_event(seq, 8'000).data);
    log.close();
  }
  write_text_file(folder / "set.yaml",
                  "name: lan\nlcm: {ttl: 1}\nsources: [RGBD_FRAME]\nprocesses:\n"
                  "  - {name: mask, exec: weft-test-stage, with: {kind: mask}, host: host-a}\n"
                  "  - {name: words, exec: weft-test-stage, with: {kind: words}, host: host-b}\n"
                  "  - {name: parts, exec: weft-test-stage, with: {kind: parts}, host: host-a}\n");
  write_text_file(folder / "script", kScript);
  const auto result =
      run_command({"timeout", "100", "unshare", "-n", "-u", "bash", (folder / "script").string(),
                   WEFT_BINARY_DIR "/bin/weft", folder.string()});
  ASSERT_EQ(result.status, 0) << result.output;

  const auto guest = nlohmann::json::parse(read_text_file(folder / "guest.json"))["elsewhere"];
  for (const char* stage : {"mask", "words", "parts"}) {
    ASSERT_TRUE(guest.contains(stage)) << result.output;
    EXPECT_GT(guest[stage]["p95_ms"], 0.0);
    EXPECT_GT(guest[stage]["frames_per_second"], 0.0);
  }
  EXPECT_EQ(guest["mask"]["host"], "host-a");
  EXPECT_EQ(guest["words"]["host"], "host-b");
  const auto status = nlohmann::json::parse(read_text_file(folder / "status.json"));
  EXPECT_TRUE(status["processes"].contains("mask"));
  EXPECT_EQ(status["elsewhere"]["words"]["host"], "host-b");

  // Nothing is lost in silence: a frame has its answer, whatever it is, or is a gap.
  const auto& parts = status["processes"]["parts"];
  const int said = parts["frames_out"].get<int>() + parts["frames_dropped"].get<int>() +
                   parts["frames_failed"].get<int>() + parts["frames_missing_input"].get<int>();
  EXPECT_EQ(said + parts["gaps"].get<int>(), kFrames) << result.output;
  std::set<std::int64_t> recorded;
  stage::LogReader log((folder / "recorded.lcm").string());
  for (stage::LogEvent event; log.next(event);) {
    if (event.channel != "PART_DETECTIONS") continue;
    if (const auto header = read_frame_header(event.data)) recorded.insert(header->frame.seq);
  }
  EXPECT_GE(static_cast<int>(recorded.size()), kFrames * 9 / 10) << result.output;
  if (!testing::Test::HasFailure()) fs::remove_all(folder);
}

}  // namespace
}  // namespace weft
