// The weft program itself, with real processes over real LCM.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "base/text_file.hpp"
#include "integration/test_log.hpp"
#include "integration/test_stage.hpp"
#include "stage/net_namespace.hpp"
#include "tools/weft/replay.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";

class WeftTest : public testing::Test {
 protected:
  WeftTest() {
    // A short path: a socket's name holds it.
    folder_ = fs::temp_directory_path() / ("weft-test-" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    write_set("set.yaml", "");
  }
  ~WeftTest() override {
    if (!HasFailure()) fs::remove_all(folder_);
  }

  void write_set(const std::string& name, const std::string& words, int work_ms = 2) const {
    const std::string work = "work_ms: " + std::to_string(work_ms);
    write_text_file(folder_ / name,
                    "name: test\nsources: [RGBD_FRAME]\nprocesses:\n"
                    "  - {name: mask, exec: weft-test-stage, with: {kind: mask, " +
                        work +
                        "}}\n"
                        "  - {name: words, exec: weft-test-stage, with: {kind: words, " +
                        work + words +
                        "}}\n"
                        "  - {name: parts, exec: weft-test-stage, with: {kind: parts, " +
                        work + "}}\n");
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  CommandResult weft(std::vector<std::string> args) const {
    args.insert(args.begin(), kWeft);
    return run_command(args);
  }
  static bool private_network_permitted() {
    const pid_t pid = fork();
    if (pid == 0) {
      std::string why;
      _exit(stage::enter_private_network(why) ? 0 : 1);
    }
    int status = 0;
    waitpid(pid, &status, 0);
    return status == 0;
  }

  fs::path folder_;
};

#define NEEDS_PRIVATE_NETWORK() \
  if (!private_network_permitted()) GTEST_SKIP() << "no network namespace is permitted here"

TEST_F(WeftTest, WrongUseIsTwo) {
  EXPECT_EQ(weft({}).status, 2);
  EXPECT_EQ(weft({"no-such-command"}).status, 2);
  EXPECT_EQ(weft({"replay", "--windw", "3"}).status, 2);
  EXPECT_EQ(weft({"log"}).status, 2);
  EXPECT_EQ(weft({"bench"}).status, 2);
  for (const std::string command : {"demo", "up", "down", "status", "logs", "restart", "replay",
                                    "timing", "log", "spy", "compare", "doctor"})
    EXPECT_EQ(weft({command, "--help"}).status, 0) << command;
}

TEST_F(WeftTest, ErrorsAreOneAndSayWhatToDo) {
  const auto no_set = weft({"up", path("none.yaml")});
  EXPECT_EQ(no_set.status, 1);
  EXPECT_NE(no_set.output.find("config/sets/"), std::string::npos) << no_set.output;
  write_text_file(path("bad.yaml"), "sources: [RGBD_FRAME]\nprocess: []\n");
  const auto bad_set = weft({"replay", "x.lcm", "--set", path("bad.yaml"), "--out", path("o.lcm")});
  EXPECT_EQ(bad_set.status, 1);
  EXPECT_NE(bad_set.output.find("bad.yaml:2: unknown key 'process'"), std::string::npos)
      << bad_set.output;
  setenv("WEFT_RUN_DIR", path("run").c_str(), 1);
  EXPECT_NE(weft({"status"}).output.find("no set is running"), std::string::npos);
}

TEST_F(WeftTest, ReplayOverLcmIsTheSameTwiceAndAsWithEveryStageInOneProcess) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 25);
  const auto first = weft({"replay", path("in.lcm"), "--set", path("set.yaml"), "--out",
                           path("a.lcm"), "--json", path("a.json"), "--verify"});
  ASSERT_EQ(first.status, 0) << first.output;
  EXPECT_NE(first.output.find("verified"), std::string::npos);
  EXPECT_FALSE(fs::exists(path("a.lcm.second")));
  const auto json = nlohmann::json::parse(read_text_file(path("a.json")));
  EXPECT_EQ(json["frames"], 25);
  EXPECT_EQ(json["answered"], 25);
  EXPECT_EQ(json["failed"], 0);
  EXPECT_GT(json["stages"]["parts"]["p50_ms"], 1.9);
  const auto other = weft({"replay", path("in.lcm"), "--set", path("wide.yaml"), "--out",
                           path("b.lcm"), "--window", "9", "--verify", path("a.lcm")});
  EXPECT_EQ(other.status, 1) << "there is no wide.yaml";
  const auto wide = weft({"replay", path("in.lcm"), "--set", path("set.yaml"), "--out",
                          path("b.lcm"), "--window", "9", "--verify", path("a.lcm")});
  EXPECT_EQ(wide.status, 0) << wide.output;
  // weft itself was not built with the test stages.
  const auto set = ProcessSet::from_file(path("set.yaml"));
  ReplayOptions options;
  options.log = path("in.lcm");
  options.out = path("c.lcm");
  const auto result =
      replay(set, Transport::kInProcess, {{"weft-test-stage", test_stage::make_stage}}, options,
             [](const PlayedFrame&, const FrameContent&) {});
  EXPECT_TRUE(result.good());
  EXPECT_EQ(first_difference(path("a.lcm"), path("c.lcm")), "");
}

TEST_F(WeftTest, ReplayedLogsHaveAFixedOrderAndTheFramesTimes) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 3);
  ASSERT_EQ(
      weft({"replay", path("in.lcm"), "--set", path("set.yaml"), "--out", path("a.lcm")}).status,
      0);
  std::vector<std::string> channels;
  stage::LogReader log(path("a.lcm"));
  stage::LogEvent event;
  while (log.next(event)) {
    channels.push_back(event.channel);
    if (channels.size() <= 24) {
      const auto frame = static_cast<std::int64_t>((channels.size() - 1) / 8);
      EXPECT_EQ(event.timestamp_us, 1'700'000'000'000'000 + frame * 100'000);
    }
  }
  std::vector<std::string> expected;
  for (int frame = 0; frame < 3; ++frame) {
    for (const char* channel : {"RGBD_FRAME", "FOREGROUND", "WORDS_SIFT", "PROBABILITY_MAP",
                                "PART_DETECTIONS", "STAGE_TIMING", "STAGE_TIMING", "STAGE_TIMING"})
      expected.push_back(channel);
  }
  for (int stage = 0; stage < 3; ++stage) expected.push_back("STAGE_STATUS");
  EXPECT_EQ(channels, expected);
}

TEST_F(WeftTest, VerifyNamesTheFirstDifference) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 5);
  write_set("impure.yaml", ", impure: true");
  ASSERT_EQ(
      weft({"replay", path("in.lcm"), "--set", path("set.yaml"), "--out", path("a.lcm")}).status,
      0);
  const auto other = weft({"replay", path("in.lcm"), "--set", path("impure.yaml"), "--out",
                           path("b.lcm"), "--verify", path("a.lcm")});
  EXPECT_EQ(other.status, 1);
  EXPECT_NE(other.output.find("not the same: WORDS_SIFT of frame camera/7/0 differs at byte"),
            std::string::npos)
      << other.output;
  EXPECT_NE(other.output.find("words_t, "), std::string::npos) << other.output;
  EXPECT_NE(other.output.find("\n  cells[0]: "), std::string::npos) << other.output;
  // The same in one command, with figures and a page.
  const auto compared = weft({"compare", path("a.lcm"), path("b.lcm"), "--json",
                              path("compare.json"), "--html", path("compare.html")});
  EXPECT_EQ(compared.status, 0) << compared.output;
  EXPECT_NE(compared.output.find("5 of 5 frames differ"), std::string::npos) << compared.output;
  const auto json = nlohmann::json::parse(read_text_file(path("compare.json")));
  EXPECT_EQ(json["channels"]["FOREGROUND"]["equal"], 5);
  EXPECT_EQ(json["channels"]["WORDS_SIFT"]["different"], 5);
  EXPECT_TRUE(fs::exists(path("compare.html")));
  EXPECT_EQ(weft({"compare", path("a.lcm")}).status, 2);
}

TEST_F(WeftTest, AReplayCanBeARangePacedAndStepped) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 12);
  const auto replay_to = [&](const std::string& out, const std::string& more) {
    return run_command({"sh", "-c",
                        "exec " + kWeft + " replay " + path("in.lcm") + " --set " +
                            path("set.yaml") + " --out " + path(out) + " " + more});
  };
  EXPECT_EQ(replay_to("whole.lcm", "</dev/null").status, 0);
  // Without keys to wait for, it goes on by itself.
  const auto frames = replay_to(
      "frames.lcm", "--from-frame 3 --to-frame 6 --step --show PART_DETECTIONS </dev/null");
  ASSERT_EQ(frames.status, 0) << frames.output;
  EXPECT_NE(frames.output.find("frame camera/7/6"), std::string::npos) << frames.output;
  EXPECT_NE(frames.output.find("detections[0].part: polo collar"), std::string::npos)
      << frames.output;
  const auto whole = payload_hashes(path("whole.lcm")), part = payload_hashes(path("frames.lcm"));
  EXPECT_EQ(part.size(), 20u);
  for (const auto& line : part)
    EXPECT_NE(std::find(whole.begin(), whole.end(), line), whole.end()) << line;
  const auto begin = Clock::now();
  const auto seconds = replay_to("seconds.lcm", "--from-s 0.2 --to-s 0.8 --speed 0.5 </dev/null");
  EXPECT_EQ(seconds.status, 0) << seconds.output;
  EXPECT_EQ(payload_hashes(path("seconds.lcm")).size(), 30u);
  EXPECT_GT(Clock::now() - begin, std::chrono::milliseconds(999)) << "6 frames, 200 ms apart";
  const auto none = replay_to("none.lcm", "--from-frame 50 </dev/null");
  EXPECT_EQ(none.status, 1);
  EXPECT_NE(none.output.find("no frame lies in this range"), std::string::npos) << none.output;
  EXPECT_FALSE(fs::exists(path("none.lcm")));
  EXPECT_EQ(run_command({kWeft, "replay", path("in.lcm"), "--set", path("set.yaml"), "--out",
                         path("in.lcm")})
                .status,
            1)
      << "the log that is played";
}

TEST_F(WeftTest, StagesThatFailAreAnsweredAndCounted) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 9);
  write_set("failing.yaml", ", fail_every: 3");
  const auto result = weft({"replay", path("in.lcm"), "--set", path("failing.yaml"), "--out",
                            path("a.lcm"), "--json", path("a.json"), "--verify"});
  EXPECT_EQ(result.status, 0) << result.output;
  const auto json = nlohmann::json::parse(read_text_file(path("a.json")));
  EXPECT_EQ(json["answered"], 9);
  EXPECT_EQ(json["failed"], 3);
}

TEST_F(WeftTest, AProcessThatCannotStartEndsTheReplayWithItsOwnWords) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 2);
  write_set("wrong.yaml", ", colour: red");
  const auto result =
      weft({"replay", path("in.lcm"), "--set", path("wrong.yaml"), "--out", path("a.lcm")});
  EXPECT_EQ(result.status, 1);
  EXPECT_NE(result.output.find("process words ended with status 1"), std::string::npos)
      << result.output;
  EXPECT_NE(result.output.find(path("wrong.yaml") + ":5: unknown key 'colour'"), std::string::npos)
      << result.output;
  EXPECT_FALSE(fs::exists(path("a.lcm")));
}

TEST_F(WeftTest, DemoWritesFiguresAndAPageWithEveryFrame) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 4);
  const auto result =
      weft({"demo", "--log", path("in.lcm"), "--set", path("set.yaml"), "--loop", "10", "--out",
            path("demo"), "--json", path("demo.json"), "--threshold", "0.1"});
  ASSERT_EQ(result.status, 0) << result.output;
  const auto json = nlohmann::json::parse(read_text_file(path("demo.json")));
  EXPECT_EQ(json["frames"], 10);
  EXPECT_EQ(json["answered"], 10);
  EXPECT_GT(json["detections"], 0);
  EXPECT_GT(json["frames_per_second"], 1.0);
  for (const char* stage : {"mask", "words", "parts"}) {
    EXPECT_GT(json["stages"][stage]["p50_ms"], 1.9) << stage;
    EXPECT_GE(json["stages"][stage]["p95_ms"], json["stages"][stage]["p50_ms"]) << stage;
  }
  const auto page = read_text_file(path("demo/index.html"));
  const auto begin = page.find("id=\"data\">") + 10;
  const auto data =
      nlohmann::json::parse(page.substr(begin, page.find("</script>", begin) - begin));
  ASSERT_EQ(data["frames"].size(), 4u) << "the second pass shows nothing new";
  for (const auto& frame : data["frames"]) {
    EXPECT_EQ(frame["detections"].size(), 1u);
    ASSERT_EQ(frame["maps"].size(), 1u);
    EXPECT_TRUE(fs::exists(folder_ / "demo" / frame["maps"][0]["image"]));
    EXPECT_FALSE(frame["outline"].empty());
  }
  EXPECT_EQ(page.find("{{"), std::string::npos);
  EXPECT_EQ(page.find("https://"), std::string::npos);
  EXPECT_EQ(
      weft({"timing", path("demo/demo.lcm"), "--json", path("t.json"), "--html", path("t.html")})
          .status,
      0);
  const auto timing = nlohmann::json::parse(read_text_file(path("t.json")));
  EXPECT_EQ(timing["stages"], json["stages"]);
  EXPECT_EQ(weft({"log", "info", path("demo/demo.lcm")}).status, 0);
}

TEST_F(WeftTest, LogToolsMendADamagedLogAndLeaveItAlone) {
  test_stage::write_test_log(path("in.lcm"), 5, 1000);
  auto bytes = read_text_file(path("in.lcm"));
  bytes[2000] = '\x55';
  bytes.resize(bytes.size() - 10);
  write_text_file(path("bad.lcm"), bytes);
  EXPECT_EQ(weft({"log", "check", path("in.lcm")}).status, 0);
  const auto check = weft({"log", "check", path("bad.lcm"), "--json", path("check.json")});
  EXPECT_EQ(check.status, 1);
  EXPECT_NE(check.output.find("the last event is cut off"), std::string::npos) << check.output;
  EXPECT_EQ(nlohmann::json::parse(read_text_file(path("check.json")))["healthy"], false);
  EXPECT_EQ(weft({"log", "repair", path("bad.lcm"), "--out", path("bad.lcm")}).status, 1);
  EXPECT_EQ(weft({"log", "repair", path("bad.lcm"), "--out", path("good.lcm")}).status, 0);
  EXPECT_EQ(read_text_file(path("bad.lcm")), bytes);
  EXPECT_EQ(weft({"log", "check", path("good.lcm")}).status, 0);
  EXPECT_EQ(
      weft({"log", "filter", path("in.lcm"), "--channel", "RGBD_.*", "--out", path("rgbd.lcm")})
          .status,
      0);
  const auto cut = weft({"log", "cut", path("rgbd.lcm"), "--from-frame", "1", "--to-frame", "3",
                         "--out", path("cut.lcm")});
  EXPECT_NE(cut.output.find("3 of 5 events"), std::string::npos) << cut.output;
  const auto splice =
      weft({"log", "splice", path("rgbd.lcm"), path("cut.lcm"), "--out", path("whole.lcm")});
  EXPECT_NE(splice.output.find("5 of 8 events, 3 copies"), std::string::npos) << splice.output;
  EXPECT_EQ(first_difference(path("rgbd.lcm"), path("whole.lcm")), "");
  EXPECT_EQ(weft({"log", "cut", path("in.lcm"), "--out", path("x.lcm")}).status, 1);
}

TEST_F(WeftTest, SpyShowsWhatIsOnTheAir) {
  NEEDS_PRIVATE_NETWORK();
  const pid_t child = fork();
  if (child == 0) {
    std::string why;
    if (!stage::enter_private_network(why)) _exit(3);
    const pid_t robot = fork();
    if (robot == 0) {
      const auto bus = make_lcm_bus(stage::LcmUrl{});
      for (std::int64_t seq = 0;; ++seq) {
        if (seq % 10 != 5) bus->publish("RGBD_FRAME", test_stage::test_event(seq, 5000).data);
        bus->receive(std::chrono::milliseconds(0));
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    }
    const auto result =
        weft({"spy", "--duration", "2", "--json", path("spy.json"), "--show", "RGBD_FRAME"});
    kill(robot, SIGKILL);
    waitpid(robot, nullptr, 0);
    std::fputs(result.output.c_str(), stderr);
    const auto json = nlohmann::json::parse(read_text_file(path("spy.json")));
    const auto& frames = json["channels"]["RGBD_FRAME"];
    const bool good = result.status == 0 && frames["type"] == "rgbd_frame_t" &&
                      frames["per_second"] > 5.0 && frames["missing"] > 0 &&
                      result.output.find("source: scene ") != std::string::npos &&
                      weft({"spy", "--duration", "0.2"}).status == 1;
    _exit(good ? 0 : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST_F(WeftTest, ReplayFromAStageTakesItsInputsFromTheLog) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 5);
  const auto replay_to = [&](const std::string& in, const std::string& out,
                             std::vector<std::string> more) {
    more.insert(more.begin(), {"replay", path(in), "--set", path("set.yaml"), "--out", path(out)});
    return weft(more);
  };
  ASSERT_EQ(replay_to("in.lcm", "a.lcm", {}).status, 0);
  const auto again = replay_to("a.lcm", "b.lcm", {"--from", "parts"});
  ASSERT_EQ(again.status, 0) << again.output;
  const auto whole = payload_hashes(path("a.lcm")), part = payload_hashes(path("b.lcm"));
  EXPECT_EQ(part.size(), 15u);
  for (const auto& line : part)
    EXPECT_NE(std::find(whole.begin(), whole.end(), line), whole.end()) << line;
  const auto impossible = replay_to("in.lcm", "c.lcm", {"--from", "parts"});
  EXPECT_EQ(impossible.status, 1);
  EXPECT_NE(impossible.output.find("no frame on WORDS_SIFT"), std::string::npos)
      << impossible.output;
  EXPECT_EQ(replay_to("in.lcm", "c.lcm", {"--from", "grasp"}).status, 1);
}

TEST_F(WeftTest, ASetWithAFeedbackEdgeIsReplayedToTheBit) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 20);
  const auto set_with = [&](const std::string& name, const std::string& track) {
    write_text_file(path(name),
                    "name: loop\nsources: [RGBD_FRAME]\nprocesses:\n"
                    "  - {name: words, exec: weft-test-stage, with: {kind: words}}\n"
                    "  - {name: track, exec: weft-test-stage, with: {kind: track, " +
                        track + "}}\n");
  };
  set_with("loop.yaml", "frames_back: 3");
  set_with("stateful.yaml", "frames_back: 3, stateful: true");
  const auto replay_to = [&](const std::string& set, const std::string& in, const std::string& out,
                             std::vector<std::string> more) {
    more.insert(more.begin(), {"replay", path(in), "--set", path(set), "--out", path(out)});
    return weft(more);
  };
  for (const std::string set : {"loop", "stateful"}) {
    const auto twice = replay_to(set + ".yaml", "in.lcm", set + ".lcm", {"--verify"});
    ASSERT_EQ(twice.status, 0) << twice.output;
  }
  EXPECT_NE(first_difference(path("loop.lcm"), path("stateful.lcm")), "");
  // The same with all stages in one process.
  ReplayOptions options;
  options.log = path("in.lcm");
  options.out = path("one.lcm");
  EXPECT_TRUE(replay(ProcessSet::from_file(path("stateful.yaml")), Transport::kInProcess,
                     {{"weft-test-stage", test_stage::make_stage}}, options,
                     [](const PlayedFrame&, const FrameContent&) {})
                  .good());
  EXPECT_EQ(first_difference(path("stateful.lcm"), path("one.lcm")), "");
  // Its feedback from the log: words stands before it in the set and is not computed again.
  const auto from = replay_to("stateful.yaml", "stateful.lcm", "from.lcm", {"--from", "track"});
  ASSERT_EQ(from.status, 0) << from.output;
  const auto whole = payload_hashes(path("stateful.lcm"));
  EXPECT_EQ(payload_hashes(path("from.lcm")).size(), 60u);
  for (const auto& line : payload_hashes(path("from.lcm")))
    EXPECT_NE(std::find(whole.begin(), whole.end(), line), whole.end()) << line;
  // In the middle of the log, where the first three have none.
  const auto part = replay_to("loop.yaml", "in.lcm", "part.lcm", {"--from-frame", "8", "--verify"});
  EXPECT_EQ(part.status, 0) << part.output;
  EXPECT_NE(part.output.find("12 of 12 frames answered on every channel, 0 failed, 0 sent again"),
            std::string::npos)
      << part.output;
}

TEST_F(WeftTest, AStageCanBeSwapped) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 3);
  write_text_file(path("other"), "#!/bin/sh\nexec " + std::string(WEFT_BINARY_DIR) +
                                     "/bin/weft-test-stage --set impure=true \"$@\"\n");
  fs::permissions(path("other"), fs::perms::owner_all);
  const auto replay_with = [&](const std::string& out, const std::string& program) {
    return weft({"replay", path("in.lcm"), "--set", path("set.yaml"), "--out", path(out), "--swap",
                 "words=" + program});
  };
  EXPECT_EQ(replay_with("a.lcm", "weft-test-stage").status, 0);
  const auto swapped = replay_with("b.lcm", path("other"));
  EXPECT_EQ(swapped.status, 0) << swapped.output;
  EXPECT_NE(first_difference(path("a.lcm"), path("b.lcm")).find("WORDS_SIFT"), std::string::npos);
  EXPECT_EQ(replay_with("c.lcm", "no-such-program").status, 1);
}

/// In a user namespace that permits no network namespace of its own, as in a default container.
TEST_F(WeftTest, WithoutNamespacesTheLoopbackIsUsedAndWithoutItOneProcess) {
  NEEDS_PRIVATE_NETWORK();
  const std::string forbid = "echo 0 > /proc/sys/user/max_net_namespaces && ";
  if (run_command({"unshare", "-U", "-r", "-n", "sh", "-c", forbid + "! unshare -n true"}).status)
    GTEST_SKIP() << "no user namespace whose limits can be set";
  test_stage::write_test_log(path("in.lcm"), 3);
  const std::string replay = "exec " + kWeft + " replay " + path("in.lcm") + " --set " +
                             path("set.yaml") + " --out " + path("a.lcm");
  const auto loopback = run_command(
      {"unshare", "-U", "-r", "-n", "sh", "-c",
       forbid + "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && " + replay});
  EXPECT_EQ(loopback.status, 0) << loopback.output;
  EXPECT_NE(loopback.output.find("on this host's loopback"), std::string::npos) << loopback.output;
  // The test stages are not built into weft, so it goes no further than choosing.
  const auto one_process = run_command({"unshare", "-U", "-r", "-n", "sh", "-c", forbid + replay});
  EXPECT_EQ(one_process.status, 1);
  EXPECT_NE(
      one_process.output.find("all stages in one process, since this machine permits neither"),
      std::string::npos)
      << one_process.output;
  EXPECT_NE(one_process.output.find("only runs as a process of its own"), std::string::npos);
}

/// Kills a stage at a time and by name, while frames are played.
TEST_F(WeftTest, StagesKilledDuringAReplayChangeNoAnswer) {
  NEEDS_PRIVATE_NETWORK();
  test_stage::write_test_log(path("in.lcm"), 40);
  ASSERT_EQ(
      weft({"replay", path("in.lcm"), "--set", path("set.yaml"), "--out", path("a.lcm")}).status,
      0);
  const pid_t pid = fork();
  if (pid == 0) {
    std::string why;
    if (!stage::enter_private_network(why)) _exit(3);
    const auto set = ProcessSet::from_file(path("set.yaml"));
    SourceLog source(path("in.lcm"), set.sources);
    Session session(set, Transport::kPrivateNetwork, {}, path("logs"), {});
    session.player().wait_ready();
    const std::vector<std::string> names = {"mask", "words", "parts"};
    stage::LogWriter out(path("b.lcm"));
    bool all = true;
    session.player().play(
        40, [&](std::size_t index) { return source.read(index); },
        [&](PlayedFrame&& frame) {
          all = all && frame.unanswered.empty();
          for (const auto& event : frame.source.events) out.write(0, event.channel, event.data);
          for (const auto& each : frame.outputs) out.write(0, each.channel, each.data);
          if (frame.index % 8 == 3)
            kill(session.children().pid(names[frame.index / 8 % 3]), SIGKILL);
        });
    out.close();
    _exit(all && session.player().restarts() >= 4 ? 0 : 1);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(first_difference(path("a.lcm"), path("b.lcm")), "");
}

/// Publishes frames and counts the detections that come back; in the namespace of its caller.
class LiveRobot {
 public:
  LiveRobot() : bus_(make_lcm_bus(stage::LcmUrl{})) {}
  /// How many of `count` new frames were answered with detections.
  int answered(int count) {
    const auto first = seq_;
    std::set<std::int64_t> seen;
    const auto listen = [&](std::chrono::milliseconds time) {
      for (const auto end = Clock::now() + time; Clock::now() < end;) {
        const auto message = bus_->receive(std::chrono::milliseconds(5));
        if (!message || message->channel != "PART_DETECTIONS") continue;
        const auto header = read_frame_header(message->data);
        if (header && header->frame.seq >= first && header->status_code <= 1)
          seen.insert(header->frame.seq);
      }
    };
    for (int i = 0; i < count; ++i) {
      bus_->publish("RGBD_FRAME", test_stage::test_event(seq_++, 60'000).data);
      listen(std::chrono::milliseconds(40));
    }
    listen(std::chrono::milliseconds(500));
    return static_cast<int>(seen.size());
  }

 private:
  std::unique_ptr<Bus> bus_;
  std::int64_t seq_ = 0;
};

#define CHECK_IN_CHILD(condition)                                        \
  if (!(condition)) {                                                    \
    std::fprintf(stderr, "line %d: not so: %s\n", __LINE__, #condition); \
    std::fputs(last_output.c_str(), stderr);                             \
    run_command({kWeft, "down"});                                        \
    _exit(1);                                                            \
  }

TEST_F(WeftTest, ASetThatIsUpSurvivesTheDeathOfAnyProcessAndStopsCleanly) {
  NEEDS_PRIVATE_NETWORK();
  if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  const pid_t child = fork();
  if (child == 0) {
    std::string why, last_output;
    if (!stage::enter_private_network(why)) _exit(3);
    setenv("WEFT_RUN_DIR", path("run").c_str(), 1);
    const auto weft_says = [&](std::vector<std::string> args) {
      auto result = weft(std::move(args));
      last_output = result.output;
      return result.status;
    };
    CHECK_IN_CHILD(weft_says({"up", path("set.yaml")}) == 0);
    CHECK_IN_CHILD(weft_says({"up", path("set.yaml")}) == 1);  // is running already
    LiveRobot robot;
    CHECK_IN_CHILD(robot.answered(10) == 10);
    const RunFolder folder(folder_ / "run" / "test");
    std::map<std::string, pid_t> pids;
    for (const std::string name : {"mask", "words", "parts"}) {
      pid_t victim = 0;
      for (const auto& process : folder.processes()) {
        if (process.name == name) victim = process.pid;
      }
      CHECK_IN_CHILD(victim > 0);
      CHECK_IN_CHILD(kill(victim, SIGKILL) == 0);
      const auto killed = Clock::now();
      while (robot.answered(5) != 5)
        CHECK_IN_CHILD(Clock::now() - killed < std::chrono::seconds(15));
    }
    CHECK_IN_CHILD(weft_says({"status", "--json", path("status.json")}) == 0);
    const auto status = nlohmann::json::parse(read_text_file(path("status.json")));
    for (const std::string name : {"mask", "words", "parts"}) {
      const auto& process = status["processes"][name];
      CHECK_IN_CHILD(process["state"] == "running" && process["starts"] == 2);
      CHECK_IN_CHILD(process["frames_out"] > 0);
      pids[name] = process["pid"];
    }
    CHECK_IN_CHILD(weft_says({"restart", "words"}) == 0);
    CHECK_IN_CHILD(kill(pids["words"], 0) != 0);
    CHECK_IN_CHILD(weft_says({"restart", "no-such"}) == 1);
    CHECK_IN_CHILD(weft_says({"logs", "words"}) == 0 && !last_output.empty());
    const auto socket = fs::status(folder.path() / "supervisor.sock").permissions();
    CHECK_IN_CHILD((socket & (fs::perms::group_all | fs::perms::others_all)) == fs::perms::none);
    CHECK_IN_CHILD(weft_says({"down"}) == 0);
    for (const auto& [name, pid] : pids) CHECK_IN_CHILD(kill(pid, 0) != 0);
    CHECK_IN_CHILD(!folder.running());
    CHECK_IN_CHILD(weft_says({"down"}) == 1);
    // The processes' own last words: they were asked to stop, not killed.
    CHECK_IN_CHILD(read_text_file(folder.path() / "parts.log").find("stopped") !=
                   std::string::npos);
    _exit(0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST_F(WeftTest, UpGivesUpOnASetThatCannotRun) {
  NEEDS_PRIVATE_NETWORK();
  if (run_command({"supervisord", "--version"}).status != 0) GTEST_SKIP() << "no supervisord";
  write_set("wrong.yaml", ", colour: red");
  const pid_t child = fork();
  if (child == 0) {
    std::string why, last_output;
    if (!stage::enter_private_network(why)) _exit(3);
    setenv("WEFT_RUN_DIR", path("run").c_str(), 1);
    const auto result = weft({"up", path("wrong.yaml")});
    last_output = result.output;
    CHECK_IN_CHILD(result.status == 1);
    CHECK_IN_CHILD(result.output.find(path("wrong.yaml") + ":5: unknown key 'colour'") !=
                   std::string::npos);
    CHECK_IN_CHILD(!RunFolder(folder_ / "run" / "test").running());
    _exit(0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_EQ(status, 0);
}

}  // namespace
}  // namespace weft
