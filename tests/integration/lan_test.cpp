// Sets on several hosts (network namespaces joined by a bridge), and several sets on one network.
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "base/text_file.hpp"
#include "integration/hosts.hpp"
#include "integration/scenarios.hpp"
#include "integration/test_log.hpp"
#include "tools/weft/frame_name.hpp"

namespace weft::test_hosts {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";

bool installed(const std::string& program) {
  return run_command({"sh", "-c", "command -v " + program}).status == 0;
}

class LanTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_hosts(); !why.empty()) GTEST_SKIP() << why;
    if (!installed("supervisord")) GTEST_SKIP() << "no supervisord";
    folder_ = fs::temp_directory_path() / ("weft-lan-" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override {
    if (!HasFailure()) fs::remove_all(folder_);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  nlohmann::json json(const std::string& name) const {
    return nlohmann::json::parse(read_text_file(folder_ / name));
  }
  fs::path folder_;
};

TEST_F(LanTest, OneSetOnTwoHostsIsPlayedAndRecordedByLcmsOwnTools) {
  for (const char* program : {"lcm-logplayer", "lcm-logger"})
    if (!installed(program)) GTEST_SKIP() << "no " << program;
  constexpr int kFrames = 60;
  {
    stage::LogWriter log(path("in.lcm"));
    for (int seq = 0; seq < kFrames; ++seq)
      log.write(1'000'000 + seq * 100'000, "RGBD_FRAME", test_stage::test_event(seq, 8'000).data);
    log.close();
  }
  write_text_file(path("set.yaml"),
                  "name: lan\nlan: true\nsources: [RGBD_FRAME]\nprocesses:\n"
                  "  - {name: mask, exec: weft-test-stage, with: {kind: mask}, host: host-a}\n"
                  "  - {name: words, exec: weft-test-stage, with: {kind: words}, host: host-b}\n"
                  "  - {name: parts, exec: weft-test-stage, with: {kind: parts}, host: host-a}\n");
  in_a_world_of_its_own([&] {
    const Lan lan({"host-a", "host-b"}, folder_);
    for (const char* host : {"host-a", "host-b"}) {
      const auto up = lan.weft(host, {"up", path("set.yaml")});
      ASSERT_EQ(up.status, 0) << up.output;
    }
    const std::string url = "--lcm-url=udpm://239.255.76.67:7667?ttl=1&recv_buf_size=4194304";
    const pid_t logger =
        lan.start("host-b", {"lcm-logger", url, path("recorded.lcm")}, path("logger.out"));
    std::this_thread::sleep_for(milliseconds(1000));
    const pid_t player =
        lan.start("host-a", {"lcm-logplayer", url, path("in.lcm")}, path("player.out"));
    std::this_thread::sleep_for(milliseconds(1000));
    // The switch is a host that runs nothing of the set.
    lan.weft("", {"status", path("set.yaml"), "--listen-s", "5", "--json", path("guest.json")});
    int status = 0;
    waitpid(player, &status, 0);
    std::this_thread::sleep_for(milliseconds(2500));
    const auto told =
        lan.weft("host-a", {"status", path("set.yaml"), "--json", path("status.json")});
    stop_process(logger);

    const auto guest = json("guest.json")["elsewhere"];
    for (const char* stage : {"mask", "words", "parts"}) {
      ASSERT_TRUE(guest.contains(stage)) << told.output;
      EXPECT_GT(guest[stage]["p95_ms"], 0.0);
      EXPECT_GT(guest[stage]["frames_per_second"], 0.0);
    }
    EXPECT_EQ(guest["mask"]["host"], "host-a");
    EXPECT_EQ(guest["words"]["host"], "host-b");
    const auto everyone = json("status.json");
    EXPECT_TRUE(everyone["processes"].contains("mask"));
    EXPECT_EQ(everyone["elsewhere"]["words"]["host"], "host-b");
    // Nothing is lost in silence: a frame has its answer, whatever it is, or is a gap.
    const auto& parts = everyone["processes"]["parts"];
    const int said = parts["frames_out"].get<int>() + parts["frames_dropped"].get<int>() +
                     parts["frames_failed"].get<int>() + parts["frames_missing_input"].get<int>();
    EXPECT_EQ(said + parts["gaps"].get<int>(), kFrames) << told.output;
    std::set<std::int64_t> recorded;
    stage::LogReader log(path("recorded.lcm"));
    for (stage::LogEvent event; log.next(event);) {
      if (event.channel != "PART_DETECTIONS") continue;
      if (const auto header = read_frame_header(event.data)) recorded.insert(header->frame.seq);
    }
    EXPECT_GE(static_cast<int>(recorded.size()), kFrames * 9 / 10) << told.output;
  });
}

TEST_F(LanTest, FramesArriveCompleteOnThreeHosts) {
  three_hosts(small_set_on_three_hosts(90, 60'000, 30), small_set(""), 90, 0);
}

TEST_F(LanTest, LostPacketsAreGapsOrMissingInputAndTheRestIsAnswered) {
  if (!installed("nft")) GTEST_SKIP() << "no nft (nftables)";
  three_hosts(small_set_on_three_hosts(90, 60'000, 30), small_set(""), 90, 20);
}

TEST_F(LanTest, TwoRobotsAndTheirCamerasDoNotDisturbEachOther) {
  constexpr int kFrames = 40;
  for (const std::string robot : {"red", "blue"}) {
    std::string text = "name: " + robot + "\nlan: true\nlcm: {prefix: " + robot +
                       "}\nsources: [RGBD_FRAME]\nprocesses:\n";
    for (const char* camera : {"left", "right"})
      text += std::string("  - {name: eye-") + camera + ", exec: weft-test-source, source: true, " +
              "camera: " + camera + ", rate_hz: 10, with: {frames: 40}}\n";
    for (const char* kind : {"mask", "words", "parts"})
      text += std::string("  - {name: ") + kind +
              ", exec: weft-test-stage, queue: 1000, with: " + "{kind: " + kind + "}}\n";
    write_text_file(path(robot + ".yaml"), text);
  }
  write_text_file(path("local.yaml"), small_set(""));
  in_a_world_of_its_own([&] {
    const Lan lan({"red", "blue"}, folder_);
    std::map<std::string, pid_t> recorders;
    for (const std::string robot : {"red", "blue"})
      recorders[robot] =
          lan.start("", {kWeft, "record", path(robot + ".lcm"), "--set", path(robot + ".yaml")},
                    path(robot + ".out"));
    std::this_thread::sleep_for(milliseconds(1500));
    for (const std::string robot : {"red", "blue"}) {
      const auto up = lan.weft(robot, {"up", path(robot + ".yaml")});
      ASSERT_EQ(up.status, 0) << up.output;
    }
    std::this_thread::sleep_for(milliseconds(kFrames * 100 + 3500));
    std::map<std::string, std::set<std::int64_t>> sessions;
    for (const std::string robot : {"red", "blue"}) {
      const auto told =
          lan.weft(robot, {"status", path(robot + ".yaml"), "--json", path("status.json")});
      EXPECT_EQ(told.status, 0) << told.output;
      const auto status = json("status.json");
      EXPECT_EQ(status["elsewhere"].size(), 0u) << told.output;
      EXPECT_EQ(status["problems"].size(), 0u) << told.output;
      for (const char* stage : {"mask", "words", "parts"}) {
        EXPECT_EQ(status["processes"][stage]["frames_out"], 2 * kFrames) << told.output;
        EXPECT_EQ(status["processes"][stage]["gaps"], 0) << told.output;
      }
      for (const char* eye : {"eye-left", "eye-right"})
        EXPECT_EQ(status["processes"][eye]["state"], "finished") << told.output;
      EXPECT_EQ(stop_process(recorders[robot]), 0) << read_text_file(path(robot + ".out"));
      const auto verdict = judge(path(robot + ".lcm"), path("local.yaml"), folder_);
      EXPECT_EQ(verdict.frames, 2 * kFrames);
      EXPECT_EQ(verdict.channels.at("PART_DETECTIONS").good, 2 * kFrames);
      for (const auto& [channel, counts] : verdict.channels) EXPECT_EQ(counts.wrong, 0) << channel;
      stage::LogReader log(path(robot + ".lcm"));
      for (stage::LogEvent event; log.next(event);) {
        if (event.channel != "PART_DETECTIONS") continue;
        if (const auto header = read_frame_header(event.data))
          sessions[robot].insert(header->frame.session);
      }
    }
    for (const auto session : sessions["red"]) EXPECT_FALSE(sessions["blue"].contains(session));
    // One that listens without a prefix, on the same group and port, hears neither.
    const auto guest = lan.weft("", {"spy", "--url", "udpm://?ttl=1", "--duration", "1.5",
                                     "--channel", "STAGE_STATUS|STAGE_TIMING|RGBD_FRAME"});
    EXPECT_EQ(guest.status, 1) << guest.output;
  });
}

TEST_F(LanTest, WithoutLanNothingIsSentToOthersNorHeardFromThem) {
  write_text_file(path("set.yaml"), small_set("trigger: message"));
  in_a_world_of_its_own([&] {
    const Lan lan({"robot", "stranger"}, folder_);  // the multicast route of both is the cable
    const auto up = lan.weft("robot", {"up", path("set.yaml")});
    ASSERT_EQ(up.status, 0) << up.output;
    const pid_t stranger = lan.start("stranger",
                                     {WEFT_BINARY_DIR "/bin/weft-test-source", "--camera",
                                      "stranger", "--rate", "20", "--url", "udpm://?ttl=1"},
                                     path("stranger.out"));
    const pid_t recorder = lan.start(
        "", {kWeft, "record", path("lan.lcm"), "--url", "udpm://?ttl=1", "--duration", "4"},
        path("record.out"));
    const auto frame = lan.weft("robot", {"trigger", path("set.yaml")});
    EXPECT_EQ(frame.status, 0) << frame.output;
    int status = 0;
    waitpid(recorder, &status, 0);
    EXPECT_EQ(status, 0) << read_text_file(path("record.out"));
    const auto told =
        lan.weft("robot", {"status", path("set.yaml"), "--json", path("status.json")});
    stop_process(stranger);
    const auto processes = json("status.json")["processes"];
    for (const char* stage : {"mask", "words", "parts"}) {
      EXPECT_EQ(processes[stage]["frames_in"], 1) << told.output;  // the one of its own camera
      EXPECT_EQ(processes[stage]["frames_out"], 1) << told.output;
    }
    EXPECT_EQ(json("status.json")["elsewhere"].size(), 0u) << told.output;
    int frames = 0;
    stage::LogReader log(path("lan.lcm"));
    for (stage::LogEvent event; log.next(event);) {
      if (event.channel == "LCM_SELF_TEST") continue;
      if (event.channel == "RGBD_FRAME") ++frames;
      const auto name = read_frame_name(event.data);
      EXPECT_TRUE(!name || name->camera == "stranger") << event.channel;
      EXPECT_TRUE(event.channel == "RGBD_FRAME" || event.channel.starts_with("STAGE_"))
          << event.channel << " left the robot";
    }
    EXPECT_GT(frames, 20) << "or the stranger was not heard at all";

    // Nobody waits for connections, and the supervisor is its owner's alone.
    for (const char* table : {"tcp", "tcp6"}) {
      const auto text = lan.run("robot", {"cat", std::string("/proc/self/net/") + table}).output;
      std::istringstream lines(text);
      std::string line;
      std::getline(lines, line);  // the head
      while (std::getline(lines, line))
        EXPECT_EQ(line.find(" 0A "), std::string::npos) << "listens: " << line;
    }
    const auto run = folder_ / "robot" / "small";
    const auto none = fs::perms::none, others = fs::perms::group_all | fs::perms::others_all;
    EXPECT_EQ(fs::status(run / "supervisor.sock").permissions() & others, none);
    EXPECT_EQ(fs::status(run).permissions() & others, none);
    const auto user = run_command({"setpriv", "--reuid=65534", "--clear-groups", "id", "-u"});
    if (user.status == 0 && user.output == "65534\n") {
      fs::permissions(folder_,
                      fs::perms::owner_all | fs::perms::group_exec | fs::perms::others_exec);
      fs::permissions(folder_ / "robot", fs::perms::owner_all | fs::perms::others_exec);
      const auto other =
          run_command({"setpriv", "--reuid=65534", "--clear-groups", "supervisorctl", "-s",
                       "unix://" + (run / "supervisor.sock").string(), "status"});
      EXPECT_NE(other.status, 0) << other.output;
      EXPECT_EQ(other.output.find("RUNNING"), std::string::npos) << other.output;
    }
    EXPECT_EQ(lan.weft("robot", {"down"}).status, 0);
  });
}

TEST_F(LanTest, CamerasTakeOneFrameWhenTheyAreTold) {
  write_text_file(path("set.yaml"),
                  small_set("camera: left, trigger: message") +
                      "  - {name: eye-right, exec: weft-test-source, source: true, camera: right, "
                      "trigger: message}\n");
  write_text_file(path("single.yaml"), small_set("camera: left, trigger: single"));
  in_a_world_of_its_own([&] {
    const Lan lan({}, folder_);
    auto up = lan.weft("", {"up", path("set.yaml")});
    ASSERT_EQ(up.status, 0) << up.output;
    const auto left = lan.weft("", {"trigger", "--camera", "left"});
    EXPECT_EQ(left.status, 0) << left.output;
    EXPECT_NE(left.output.find("RGBD_FRAME: frame left/"), std::string::npos) << left.output;
    EXPECT_EQ(lan.weft("", {"trigger", path("set.yaml")}).status, 0);  // both of them
    const auto nobody = lan.weft("", {"trigger", "--camera", "none", "--timeout-s", "1"});
    EXPECT_EQ(nobody.status, 1);
    EXPECT_NE(nobody.output.find("trigger: message and camera: none"), std::string::npos)
        << nobody.output;
    std::this_thread::sleep_for(milliseconds(1500));
    EXPECT_EQ(lan.weft("", {"status", "--json", path("status.json")}).status, 0);
    auto processes = json("status.json")["processes"];
    EXPECT_EQ(processes["eye"]["frames_out"], 2);
    EXPECT_EQ(processes["eye-right"]["frames_out"], 1);
    EXPECT_EQ(processes["parts"]["frames_out"], 3);
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);

    up = lan.weft("", {"up", path("single.yaml")});
    ASSERT_EQ(up.status, 0) << up.output;
    for (int shots = 1; shots <= 2; ++shots) {
      std::this_thread::sleep_for(milliseconds(2500));
      const auto told = lan.weft("", {"status", "--json", path("status.json")});
      EXPECT_EQ(told.status, 0) << told.output;
      processes = json("status.json")["processes"];
      EXPECT_EQ(processes["eye"]["state"], "finished") << told.output;
      EXPECT_EQ(processes["eye"]["starts"], shots) << told.output;
      EXPECT_EQ(processes["parts"]["frames_out"], shots) << told.output;
      if (shots == 1) {
        EXPECT_EQ(lan.weft("", {"restart", "eye"}).status, 0);
      }
    }
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);
  });
}

TEST_F(LanTest, StatusAndDoctorPointOutStagesThatDoNotFitTogetherOrTheSet) {
  // parts reads the mask's messages as if they were words.
  write_text_file(path("planes.yaml"), "");
  write_text_file(path("set.yaml"),
                  "name: small\nlan: true\nsources: [RGBD_FRAME]\nprocesses:\n"
                  "  - {name: mask, exec: weft-test-stage, with: {kind: mask}, host: near}\n"
                  "  - {name: parts, exec: weft-test-stage, with: {kind: parts}, host: near, map: "
                  "{WORDS_SIFT: FOREGROUND}}\n"
                  "  - {name: planes, exec: weft-planes, settings: planes.yaml, host: near}\n");
  write_text_file(
      path("lonely.yaml"),
      read_text_file(path("set.yaml")) +
          "  - {name: words, exec: weft-test-stage, with: {kind: words}, host: nowhere}\n");
  in_a_world_of_its_own([&] {
    const Lan lan({"near", "far"}, folder_);
    const auto up = lan.weft("near", {"up", path("set.yaml")});
    ASSERT_EQ(up.status, 0) << up.output;
    const auto alone = lan.weft("far", {"status", path("lonely.yaml")});
    EXPECT_EQ(alone.status, 1) << alone.output;
    EXPECT_NE(alone.output.find("nothing is heard of words on nowhere"), std::string::npos)
        << alone.output;
    ASSERT_EQ(lan.run("far", {"ip", "route", "replace", "224.0.0.0/4", "dev", "lo"}).status, 0);
    const auto lost = lan.weft("far", {"doctor", path("set.yaml"), "--listen-s", "0.2"});
    EXPECT_EQ(lost.status, 1) << lost.output;
    EXPECT_NE(lost.output.find("the multicast route leads to lo"), std::string::npos)
        << lost.output;
    ASSERT_EQ(lan.run("far", {"ip", "route", "replace", "224.0.0.0/4", "dev", "eth0"}).status, 0);
    // As if the file of the other host were another.
    write_text_file(path("planes.yaml"), "labels: false\n");
    for (const std::string command : {"status", "doctor"}) {
      const auto told = lan.weft("far", {command, path("set.yaml")});
      EXPECT_EQ(told.status, 1) << told.output;
      EXPECT_NE(told.output.find("FOREGROUND: "), std::string::npos) << told.output;
      EXPECT_NE(told.output.find("its messages do not decode"), std::string::npos) << told.output;
      EXPECT_NE(told.output.find("build both from the same lcmtypes/"), std::string::npos);
      EXPECT_NE(told.output.find("planes on near (process "), std::string::npos) << told.output;
      EXPECT_NE(told.output.find("runs with settings "), std::string::npos) << told.output;
    }
    EXPECT_EQ(lan.weft("near", {"down"}).status, 0);
  });
}

TEST_F(LanTest, DoctorMeasuresHowFarTheClocksOfHostsAreApart) {
  const auto library = run_command({"sh", "-c", "ls /usr/lib/*/faketime/libfaketimeMT.so.1"});
  if (library.status != 0) GTEST_SKIP() << "no libfaketime to set a host's clock with";
#ifdef __SANITIZE_ADDRESS__
  GTEST_SKIP() << "libfaketime is preloaded, and the address sanitizer must come first";
#endif
  const std::string preload = "LD_PRELOAD=" + library.output.substr(0, library.output.find('\n'));
  write_text_file(path("set.yaml"),
                  "name: clocks\nlan: true\nsources: [RGBD_FRAME]\nprocesses:\n"
                  "  - {name: mask, exec: weft-test-stage, with: {kind: mask}, host: near}\n"
                  "  - {name: words, exec: weft-test-stage, with: {kind: words}, host: far}\n");
  in_a_world_of_its_own([&] {
    const Lan lan({"near", "far"}, folder_);
    const auto near = lan.weft("near", {"up", path("set.yaml")});
    ASSERT_EQ(near.status, 0) << near.output;
    // The clock of every process there is a quarter of a second ahead.
    const auto far =
        lan.run("far", {"env", preload, "FAKETIME=+0.25", "FAKETIME_DONT_FAKE_MONOTONIC=1", kWeft,
                        "up", path("set.yaml")});
    ASSERT_EQ(far.status, 0) << far.output;
    const auto told = lan.weft("near", {"doctor", path("set.yaml")});
    std::printf("%s", told.output.c_str());
    const auto at = told.output.find("clock of far: ");
    ASSERT_NE(at, std::string::npos) << told.output;
    double offset_ms = 0, uncertain_ms = 0;
    ASSERT_EQ(
        std::sscanf(told.output.c_str() + at, "clock of far: %lf ms ahead of this one's (+- %lf",
                    &offset_ms, &uncertain_ms),
        2)
        << told.output;
    EXPECT_NEAR(offset_ms, 250, uncertain_ms + 1);
    EXPECT_NE(told.output.find("on far: sudo apt-get install -y chrony"), std::string::npos);
    EXPECT_EQ(told.output.find("clock of near"), std::string::npos);
    EXPECT_EQ(lan.weft("near", {"down"}).status, 0);
    EXPECT_EQ(lan.weft("far", {"down"}).status, 0);
  });
}

}  // namespace
}  // namespace weft::test_hosts
